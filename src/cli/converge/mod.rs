//! `lightpath converge`: measures error against time; writes a table, JSON, CSV and a page.

pub mod args;
mod page;
mod text;

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::lab::backend::TestedBackend;
use crate::lab::compare::file::{FileFormat, Picture};
use crate::lab::compare::layer::{Meaning, PictureLayer};
use crate::lab::converge::{
    self, ReferencePicture, StudyGrid, StudyLimits, StudyNames, StudySettings, report,
};
use crate::monitor::Monitor;
use crate::output::exr_read;
use crate::scene::{SamplerKind, Scene};
use crate::simd::Isa;
use crate::studio;
use crate::units::counted;

use super::load::{self, SceneRequest};
use super::outputs::OutputFlags;
use super::{machine, overrides, print, signals};

use self::args::ConvergeArgs;

/// Default numbers of samples on area lights, suns and environments.
const LIGHT_SAMPLES: [u32; 3] = [1, 4, 16];

/// Runs the study of one scene.
pub fn run(args: &ConvergeArgs) -> Result<()> {
    let started = Instant::now();
    let mut limits = limits(args)?;
    let isa = args.kernels.isa()?;
    let monitor = Arc::new(Monitor::default());
    let mut request = SceneRequest::new(&args.input);
    overrides::add_size(&mut request.overrides, args.picture.size);
    overrides::add_sets(&mut request.overrides, &args.overrides.set);
    let mut job = load::load(request, &monitor)?;
    let inputs = job.inputs(&args.input).into_iter().chain(args.reference.clone());
    let outputs = OutputFlags(vec![
        ("--json FILE", &args.json),
        ("--csv FILE", &args.csv),
        ("--html FILE", &args.html),
    ]);
    outputs.refuse_overwrites(inputs)?;
    let scene = &job.loaded.scene;
    let tested_backends = tested_backends(args, scene, isa)?;
    let grid = grid(args, scene, tested_backends.len())?;
    let most = grid.light_samples.iter().flatten().copied().max();
    if scene.can_skip_shadow_rays_with(most) {
        // The study replaces the scene's own numbers of samples, which the check knows.
        job.warnings.retain(|warning| !warning.place.contains("/adaptiveshadows"));
    }
    let given = args.reference.as_deref().map(|path| read_reference(path, scene)).transpose()?;
    signals::watch(&monitor)?;
    let mut outputs = outputs.create()?;
    let note = |text: &str| args.messages.note(text);
    if let Some(seed) = args.reference.as_deref().and_then(seed_of) {
        limits.seed = args.seed.unwrap_or(seed.wrapping_add(1));
        if (0..i64::from(limits.repeats)).any(|i| limits.seed.wrapping_add(i) == seed) {
            note(&format!(
                "warning: the reference has the seed {seed}, and so has one render of every setting: shared samples \
                 make errors too small; choose another --seed"
            ));
        }
    }
    let settings = StudySettings { tested_backends, grid, limits, started, isa };
    let pool = args.workers.pool()?;
    let study = pool.install(|| {
        let mut world = job.world(&monitor, false, note)?;
        let reference = given.as_ref().map(|layer| {
            let values = layer.values.clone();
            ReferencePicture { values, floor: None }
        });
        converge::run(&mut world, &settings, reference, &monitor, &note)
    })?;
    let file = args.reference.as_ref().map(|path| path.display().to_string());
    let camera = &job.loaded.scene.camera;
    let subject = StudyNames {
        machine: machine::describe(isa),
        threads: pool.0.current_num_threads(),
        scene: args.input.display().to_string(),
        hash: job.loaded.hash,
        size: [camera.width, camera.height],
        backends: settings.tested_backends.into_iter().map(|c| c.name).collect(),
        reference: file.zip(given.map(|layer| layer.half)),
    };
    let found = report(&study, subject, limits, started.elapsed().as_secs_f64());
    let mut shown = print::Report::new(!outputs.is_empty());
    shown.text(&text::text(&found))?;
    outputs.write_json("--json", &found)?;
    outputs.write("--csv", || text::csv(&found))?;
    outputs.write("--html", || page::page(&found, &study).html())?;
    shown.end()?;
    print::paths(&outputs.written())
}

fn limits(args: &ConvergeArgs) -> Result<StudyLimits> {
    if !(args.budget > 0.0 && args.budget <= 1e6) {
        let message = format!("found {}, expected seconds in (0, 1e6]", args.budget);
        return Err(Error::invalid("--budget", message));
    }
    Ok(StudyLimits { budget: args.budget, repeats: args.repeats, seed: args.seed.unwrap_or(0) })
}

fn tested_backends(args: &ConvergeArgs, scene: &Scene, isa: Isa) -> Result<Vec<TestedBackend>> {
    let own = [scene.backend.name().to_string()];
    let names = if args.backends.is_empty() { &own[..] } else { &args.backends };
    let parsed = names.iter().map(|name| TestedBackend::parse("--backends", name, isa));
    TestedBackend::distinct("--backends", parsed)
}

fn grid(args: &ConvergeArgs, scene: &Scene, backend_count: usize) -> Result<StudyGrid> {
    let sorted = |values: &[u32]| {
        let mut values = values.to_vec();
        values.sort_unstable();
        values.dedup();
        values
    };
    let unused = studio::unused_light_samples(scene);
    let light_samples = match (unused, args.light_samples.as_slice()) {
        (None, []) => LIGHT_SAMPLES.to_vec(),
        (None, asked) => sorted(asked),
        (Some(_), []) => Vec::new(),
        (Some(message), _) => {
            return Err(Error::invalid("--light-samples", message).help("leave it out"));
        }
    };
    let mut samplers: Vec<SamplerKind> = Vec::new();
    for sampler in &args.sampler {
        if !samplers.contains(sampler) {
            samplers.push(*sampler);
        }
    }
    let light_samples = match light_samples.is_empty() {
        true => vec![None],
        false => light_samples.into_iter().map(Some).collect(),
    };
    Ok(StudyGrid { backend_count, samplers, spp: sorted(&args.spp), light_samples })
}

/// Reads the seed from the header of an EXR; `None` if this program did not write the file.
fn seed_of(path: &Path) -> Option<i64> {
    exr_read::ExrReader::open(path).ok()?.attribute("lightpath:seed")?.parse().ok()
}

/// Reads a reference: R, G, B of an EXR that has the scene's size.
fn read_reference(path: &Path, scene: &Scene) -> Result<PictureLayer> {
    let place = || path.display().to_string();
    let picture = Picture::read(path)?;
    if picture.format != FileFormat::Exr {
        let message = "found a PNG, expected an EXR: errors are measured in linear light";
        return Err(Error::invalid(place(), message)
            .help("lightpath render SCENE --float --spp 4096 -o reference"));
    }
    let light = |layer: &PictureLayer| layer.name.is_empty() && layer.meaning == Meaning::Light;
    let Some(layer) = picture.layers.into_iter().find(light) else {
        return Err(Error::invalid(place(), "found no R G B, expected the picture itself"));
    };
    if layer.is_grey() {
        let message = "found a grey picture (Y alone), expected R G B as rendered";
        return Err(Error::invalid(place(), message));
    }
    let size = [scene.camera.width, scene.camera.height];
    if layer.size != size.map(|n| n as usize) || layer.origin != [0, 0] {
        let [[w, h], [x, y], [width, height]] =
            [layer.size.map(|n| n as i64), layer.origin.map(i64::from), size.map(i64::from)];
        let message = format!(
            "found {w} x {h} pixels at ({x}, {y}), expected the whole frame of {width} x {height}"
        );
        return Err(Error::invalid(place(), message).help(format!("--size {w}x{h}")));
    }
    let bad = layer.values.iter().filter(|value| !value.is_finite()).count();
    if bad > 0 {
        let values = counted(bad as u64, ["value that is", "values that are"]);
        let message = format!("found {values} NaN or infinite, expected none");
        return Err(Error::invalid(place(), message));
    }
    Ok(layer)
}
