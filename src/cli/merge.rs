//! `lightpath merge`: merges the parts of a picture into the files that one render would have
//! written.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::{Args, ValueHint};

use crate::error::{Error, Result};
use crate::merge::Parts;
use crate::monitor::{Monitor, Phase};
use crate::output::{Outputs, WriteOptions, exr};
use crate::units::plural;
use crate::{paths, picture};

use super::flags::{MessageArgs, PrefixArgs, WorkerArgs};
use super::progress::{Progress, ProgressMode};
use super::render::{layers, progress as render_progress};
use super::{outputs, print, signals};

/// Arguments of `lightpath merge`.
#[derive(Debug, Args)]
pub struct MergeArgs {
    /// EXRs of parts: from `lightpath render` with --tile, --samples, --part or --crop
    #[arg(required = true, value_name = "PART.exr", value_hint = ValueHint::FilePath)]
    pub parts: Vec<PathBuf>,

    /// Write PREFIX.exr and PREFIX.png
    #[arg(short, long, value_name = "PREFIX", required = true, value_hint = ValueHint::FilePath)]
    pub output: PathBuf,

    /// Also write layers as pictures PREFIX.NAME.png; `all` for every layer
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub png_layer: Vec<String>,

    #[command(flatten)]
    pub files: PrefixArgs,

    #[command(flatten)]
    pub workers: WorkerArgs,

    #[command(flatten)]
    pub messages: MessageArgs,
}

/// Merges the parts of one picture and writes its files.
pub fn run(args: &MergeArgs) -> Result<()> {
    let start = Instant::now();
    let monitor = Arc::new(Monitor::default());
    let pool = args.workers.pool()?;
    let parts = Parts::open(&args.parts)?;
    let part = &parts.part;
    let first = args.parts.first().map_or(Path::new(""), PathBuf::as_path);
    let prefix = paths::prefix(Some(&args.output), first);
    let mut attributes = parts.attributes()?;
    let manifests = match args.files.crypto_sidecar {
        true => picture::manifests(&mut attributes, &prefix)?,
        false => Vec::new(),
    };
    let previews = layers::named_previews(&args.png_layer, &part.layout, &prefix)?;
    let no_mattes = args.files.crypto_sidecar && manifests.is_empty();
    let no_mattes = no_mattes.then(|| layers::no_mattes().help("render with --aov cryptomatte"));
    let no_layers = !args.png_layer.is_empty() && previews.is_empty();
    let no_layers = no_layers.then(|| layers::no_layers().help("render with --aov all"));
    let outputs = Outputs::names(&prefix).into_iter();
    let outputs = outputs.chain(manifests.iter().map(|m| m.path.clone()));
    let outputs: Vec<PathBuf> = outputs.chain(previews.iter().map(|(_, p)| p.clone())).collect();
    outputs::refuse_overwrites(&args.parts, &outputs, "-o PREFIX")?;
    signals::watch(&monitor)?;
    let mut files = Outputs::create(&prefix)?;
    let manifests =
        manifests.into_iter().map(picture::Manifest::create).collect::<Result<Vec<_>>>()?;
    let previews = layers::open_previews(previews)?;
    let mode = if args.messages.quiet { ProgressMode::Off } else { ProgressMode::Auto };
    let progress = Progress::start(mode, render_progress::meter(&monitor));

    let Some(tonemap) = part.files.curve() else {
        return Err(Error::invalid("parts", "found an unknown tone curve"));
    };
    let options = WriteOptions {
        tonemap: &tonemap,
        transparent: part.files.transparent,
        over: None,
        depth: part.files.depth,
        legend: part.files.legend.as_ref(),
        fingerprint: None,
        exr: exr::Options {
            attributes: &attributes,
            view: parts.view(),
            sequence: parts.sequence(),
            render_seconds: None,
            float: part.files.float,
            exact: false,
            compression: part.files.compression,
            multipart: part.files.multipart,
        },
    };
    let (paths, oddities) = pool.install(|| -> Result<_> {
        monitor.begin(Phase::Load, u64::from(part.whole().height()));
        let film = parts.film(&monitor)?;
        let manifests = manifests.into_iter().map(|m| picture::Manifest::write(m, &mut files));
        let mut beside = manifests.collect::<Result<Vec<_>>>()?;
        beside.extend(layers::write_previews(&film, previews, |part| files.add(part))?);
        let (written, oddities) = files.write(&film, &options, &monitor)?;
        // All further files are in `beside`, in the order of the messages.
        let paths = written.into_iter().take(2).map(|(path, _)| path);
        Ok((paths.chain(beside).collect::<Vec<_>>(), oddities))
    })?;
    if !args.messages.quiet {
        for warning in no_mattes.iter().chain(&no_layers) {
            progress.message(&format!("warning: {warning}"));
        }
        if part.files.over {
            progress.message(
                "warning: parts were made with --over: the merged PNG is without the plate",
            );
        }
        for warning in picture::oddity_warnings(&oddities) {
            progress.message(&format!("warning: {warning}"));
        }
        if !parts.is_one_scene() {
            progress.message(
                "warning: a mesh of the parts came through a pipe: whether the parts show one \
                 scene was not checked",
            );
        }
        if parts.lossy() {
            progress.message(
                "note: the parts have lost precision in their compression: the EXR does not have \
                 the bytes of one render; render the parts with --part",
            );
        } else if !parts.exact() {
            progress.message(
                "note: the parts hold 16-bit floats: the EXR has the bytes of one render, values \
                 of the PNG may differ; render the parts with --part",
            );
        }
    }
    drop(progress);
    let seconds = start.elapsed().as_secs_f64();
    args.messages.note(&format!("{} merged in {seconds:.2} s", plural(args.parts.len(), "part")));
    print::paths(&paths)?;
    args.files.check(&oddities)
}
