//! Arguments of `lightpath converge`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::cli::flags::{KernelArgs, MessageArgs, SetArgs, SizeArgs, WorkerArgs};
use crate::scene::SamplerKind;

/// Arguments of `lightpath converge`.
#[derive(Debug, Args)]
pub struct ConvergeArgs {
    /// A scene.json, a mesh.ply (in the built-in studio), or - for a scene on stdin
    #[arg(value_name = "SCENE|FILE.ply|-", value_hint = ValueHint::FilePath)]
    pub input: PathBuf,

    /// Reference to measure errors against: an EXR of the scene's size [default: rendered several
    /// times, so that its own error is known]
    #[arg(long, value_name = "R.exr", value_hint = ValueHint::FilePath)]
    pub reference: Option<PathBuf>,

    /// One or more of bvh, bvh:portable, bvh:neon, bvh:avx2, bvh:avx512, embree, embree-fast,
    /// embree-compact, coursework, brute; the first one renders the reference [default: the
    /// scene's]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Vec<String>,

    /// How sample points are chosen
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = "sobol,random")]
    pub sampler: Vec<SamplerKind>,

    /// Camera samples per pixel; with 1, the ray goes through the middle of the pixel
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "1,4,16,64", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: Vec<u32>,

    /// Samples on every area light, sun and environment per shading point [default: 1,4,16 if there
    /// are such lights]
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub light_samples: Vec<u32>,

    /// Renders per setting, each with its own seed; a setting is one backend, sampler and number of
    /// camera and light samples
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeats: u32,

    /// Seconds for the whole study, loading and reference included; settings that do not fit are
    /// left out and listed
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, allow_negative_numbers = true)]
    pub budget: f64,

    /// First seed [default: 0, or one more than the seed of the --reference]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    #[command(flatten)]
    pub picture: SizeArgs,

    #[command(flatten)]
    pub overrides: SetArgs,

    #[command(flatten)]
    pub kernels: KernelArgs,

    #[command(flatten)]
    pub workers: WorkerArgs,

    /// Write all results, with the times of all repeats, as JSON
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub json: Option<PathBuf>,

    /// Write a table of the times and errors of all settings
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub csv: Option<PathBuf>,

    /// Write one page with charts and pictures
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    #[command(flatten)]
    pub messages: MessageArgs,
}
