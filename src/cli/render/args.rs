//! Arguments of `lightpath render`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};

use crate::cli::flags::{
    ExrArgs, LookArgs, MachineArgs, MeshReadArgs, MultipartArgs, NoiseArgs, PlacementArgs,
    PrefixArgs, SceneArgs,
};
use crate::cli::progress::ProgressMode;
use crate::error::{Error, Result};
use crate::output::exr::Sequence;
use crate::output::tonemap::Depth;
use crate::picture::Storage;
use crate::render::sampling::Sampling;
use crate::studio::Subject;
use crate::units::parse_rate;

use super::dataset::DatasetArgs;
use super::plate::OverArgs;

/// Arguments of `lightpath render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A scene.json, a mesh.ply (in the built-in studio), or - for a scene on stdin
    #[arg(value_name = "SCENE|FILE.ply|-", value_hint = ValueHint::FilePath)]
    pub input: PathBuf,

    /// Write PREFIX.exr and PREFIX.png [default: the input's name, in the working folder]
    #[arg(short, long, value_name = "PREFIX", value_hint = ValueHint::FilePath)]
    pub output: Option<PathBuf>,

    #[command(flatten)]
    pub scene: SceneArgs,

    #[command(flatten)]
    pub sampling: SamplingArgs,

    #[command(flatten)]
    pub mesh: MeshArgs,

    #[command(flatten)]
    pub files: FileArgs,

    #[command(flatten)]
    pub split: SplitArgs,

    #[command(flatten)]
    pub machine: MachineArgs,

    #[command(flatten)]
    pub report: ReportArgs,
}

/// Flags for the number of samples of each pixel.
#[derive(Debug, Args)]
#[command(next_help_heading = "Sampling")]
pub struct SamplingArgs {
    #[command(flatten)]
    pub noise: NoiseArgs,

    /// Take more samples until rendering has taken SECONDS; the picture is not reproducible
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub time: Option<f64>,
}

impl SamplingArgs {
    /// Returns the adaptive sampling that the flags ask for.
    pub fn sampling(&self) -> Sampling {
        Sampling { time: self.time, ..self.noise.sampling() }
    }
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Meshes")]
pub struct MeshArgs {
    #[command(flatten)]
    pub placement: PlacementArgs,

    /// Show the .ply in this scene instead of the built-in studio; its first trimesh is replaced
    #[arg(long, value_name = "SCENE", value_hint = ValueHint::FilePath)]
    pub template: Option<PathBuf>,

    #[command(flatten)]
    pub looks: LookArgs,

    /// Save the scene that is rendered, overrides and framing included
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub write_scene: Option<PathBuf>,

    #[command(flatten)]
    pub reading: MeshReadArgs,
}

impl MeshArgs {
    /// Returns the mesh at `path` with the settings of these flags.
    ///
    /// # Errors
    /// As for [`LookArgs::appearance`].
    pub fn subject<'a>(&self, path: &'a Path) -> Result<Subject<'a>> {
        let plain = Subject::new(path);
        Ok(Subject {
            up: self.placement.up,
            rotate: self.placement.rotate,
            margin: self.placement.margin.unwrap_or(plain.margin),
            looks: self.looks.appearance()?,
            repair: self.reading.repair,
            no_mmap: self.reading.no_mmap,
            ..plain
        })
    }
}

/// Flags for output files.
#[derive(Debug, Args)]
#[command(next_help_heading = "Files")]
pub struct FileArgs {
    #[command(flatten)]
    pub parts: MultipartArgs,

    /// Number of the frame in a sequence, for the EXR's imageCounter
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frame: Option<i32>,

    /// Frame rate for the EXR: 24 or 24000/1001
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub fps: Option<(i32, u32)>,

    /// Write the render time into the EXR; its bytes then differ from run to run
    #[arg(long)]
    pub record_time: bool,

    #[command(flatten)]
    pub values: ExrArgs,

    /// Bits per channel of the PNG [default: 8]
    #[arg(long, value_name = "BITS")]
    pub png_bits: Option<Depth>,

    /// Also write layers of the EXR as pictures PREFIX.NAME.png; `all` for every layer
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub png_layer: Vec<String>,

    #[command(flatten)]
    pub plate: OverArgs,

    #[command(flatten)]
    pub dataset: DatasetArgs,

    #[command(flatten)]
    pub prefix: PrefixArgs,
}

impl FileArgs {
    /// Returns the frame's index and the frame rate for the EXR header.
    pub fn sequence(&self) -> Sequence {
        Sequence { frame: self.frame, per_second: self.fps }
    }

    /// Returns the format of the pictures.
    pub fn storage(&self) -> Storage {
        Storage {
            float: self.values.float,
            compression: self.values.compression.unwrap_or_default(),
            multipart: self.parts.multipart,
            depth: self.png_bits.unwrap_or_default(),
            crypto_sidecar: self.prefix.crypto_sidecar,
        }
    }
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Messages")]
pub struct ReportArgs {
    /// Write times, rays and memory as JSON
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath)]
    pub stats: Option<PathBuf>,

    /// Print the statistics and the written paths as one JSON object on stdout
    #[arg(long)]
    pub json: bool,

    /// Only errors on stderr, and what --progress asks for
    #[arg(long)]
    pub quiet: bool,

    /// Progress on stderr; auto is a bar on a terminal, else plain
    #[arg(long, value_name = "MODE")]
    pub progress: Option<ProgressMode>,
}

/// Flags for parts of a picture.
#[derive(Debug, Args)]
#[command(
    next_help_heading = "Parts (`lightpath merge` joins them to the same bytes as one render)"
)]
pub struct SplitArgs {
    /// Render only part I (1 to N) of N: a band of rows of the frame or the --crop
    #[arg(long, value_name = "I/N", value_parser = parse_tile)]
    pub tile: Option<[u32; 2]>,

    /// Render only the samples A to B - 1 of each pixel, counted from 0
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    pub samples: Option<[u32; 2]>,

    /// With --samples: number of samples of all parts together [default: the scene's spp]
    #[arg(long, value_name = "N", requires = "samples")]
    pub of: Option<u32>,

    /// Keep all bits in the EXR, so that merged parts from --crop also give the same PNG
    #[arg(long)]
    pub part: bool,
}

impl SplitArgs {
    /// Refuses a range of samples together with adaptive sampling, where each pixel has its own
    /// number of samples.
    ///
    /// # Errors
    /// `Invalid` for both together.
    pub fn check_sampling(&self, adaptive: bool) -> Result<()> {
        if !(adaptive && self.samples.is_some()) {
            return Ok(());
        }
        let message =
            "found with --noise or --time, where each pixel has its own number of samples";
        Err(Error::invalid("--samples", message).help("split with --tile"))
    }
}

/// Parses `3/8` to [3, 8].
fn parse_tile(text: &str) -> std::result::Result<[u32; 2], String> {
    let expected = || "expected I/N with I from 1 to N, for example 3/8".to_string();
    let (i, n) = text.split_once('/').ok_or_else(expected)?;
    let number = |text: &str| text.parse().map_err(|_| expected());
    let [i, n]: [u32; 2] = [number(i)?, number(n)?];
    if i >= 1 && i <= n { Ok([i, n]) } else { Err(expected()) }
}

/// Parses a range of samples, its end excluded: `16..32` to [16, 32].
pub fn parse_range(text: &str) -> std::result::Result<[u32; 2], String> {
    let expected =
        || "expected A..B with A < B, from 0 and without B, for example 16..32".to_string();
    let (a, b) = text.split_once("..").ok_or_else(expected)?;
    let number = |text: &str| text.parse().map_err(|_| expected());
    let [a, b]: [u32; 2] = [number(a)?, number(b)?];
    if a < b { Ok([a, b]) } else { Err(expected()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_and_ranges() {
        assert_eq!(parse_tile("3/8"), Ok([3, 8]));
        assert_eq!(parse_range("0..16"), Ok([0, 16]));
        for bad in ["", "3", "0/8", "9/8", "-1/8", "1/0", "a/b", "1/2/3", "1/99999999999"] {
            assert!(parse_tile(bad).is_err(), "{bad}");
        }
        for bad in ["", "3", "3..3", "4..3", "..3", "3..", "-1..3", "0..=3", "1..99999999999"] {
            assert!(parse_range(bad).is_err(), "{bad}");
        }
    }
}
