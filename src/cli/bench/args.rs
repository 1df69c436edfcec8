//! Arguments of `lightpath bench`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::cli::flags::{KernelArgs, MessageArgs, SizeArgs};
use crate::cli::outputs::OutputFlags;

/// Arguments of `lightpath bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Scenes, or meshes in the built-in scene: ground, one point light and one area light
    #[arg(required = true, value_name = "SCENE|FILE.ply", value_hint = ValueHint::FilePath)]
    pub inputs: Vec<PathBuf>,

    /// Backends to compare: bvh, embree, embree-fast, embree-compact, coursework, brute; bvh:TIER
    /// forces an instruction set (portable, neon, avx2, avx512). All are compared with the first
    /// [default: embree,bvh; bvh alone without Embree]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Vec<String>,

    /// Classes of rays: primary, shadow-point, shadow-area, mirror, diffuse [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub classes: Vec<String>,

    #[command(flatten)]
    pub kernels: KernelArgs,

    /// Measure with one thread and with N [default: all that this process may use]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,

    /// Maximum number of rays per class
    #[arg(long, value_name = "N", default_value_t = 1 << 18, value_parser = clap::value_parser!(u64).range(1..=1 << 28))]
    pub rays: u64,

    /// Seconds per comparison
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    pub seconds: f64,

    /// Rounds of A B B A per comparison, however long they take
    #[arg(long, value_name = "N", conflicts_with = "seconds", value_parser = clap::value_parser!(u16).range(1..=500))]
    pub rounds: Option<u16>,

    /// Use a small picture, few rays and few rounds: to test the command, not the speed
    #[arg(long, conflicts_with_all = ["seconds", "rounds", "rays", "size"])]
    pub quick: bool,

    #[command(flatten)]
    pub picture: SizeArgs,

    /// Seed of the diffuse rays
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,

    /// Write all results, with every sample, as JSON
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub json: Option<PathBuf>,

    /// Write one page with charts
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    /// Write the same JSON for a later --baseline
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub save_baseline: Option<PathBuf>,

    /// Compare with an earlier run
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub baseline: Option<PathBuf>,

    #[command(flatten)]
    pub messages: MessageArgs,
}

impl BenchArgs {
    /// Returns the flags that name output files.
    pub fn outputs(&self) -> OutputFlags<'_> {
        OutputFlags(vec![
            ("--json FILE", &self.json),
            ("--html FILE", &self.html),
            ("--save-baseline FILE", &self.save_baseline),
        ])
    }
}
