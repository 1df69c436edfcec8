//! Arguments of `lightpath crosscheck`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::cli::flags::{KernelArgs, SetArgs, SizeArgs, WorkerArgs};
use crate::scene::written::AcceleratorName;

/// Arguments of `lightpath crosscheck`.
#[derive(Debug, Args)]
pub struct CrosscheckArgs {
    /// A scene.json, a mesh.ply (in the built-in studio), or - for a scene on stdin
    #[arg(value_name = "SCENE|FILE.ply|-", value_hint = ValueHint::FilePath, required_unless_present = "replay")]
    pub input: Option<PathBuf>,

    /// Two or more backends [default: all that can run on this machine]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Option<Vec<AcceleratorName>>,

    /// Most rays to check, in equal shares for each source of rays; at least one packet of up to 16
    /// rays of each source
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,

    /// Seed of the scene and of the random rays [default: the scene's]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    /// Do not render and compare pictures
    #[arg(long)]
    pub no_picture: bool,

    #[command(flatten)]
    pub picture: SizeArgs,

    /// Camera samples per pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub spp: Option<u32>,

    #[command(flatten)]
    pub overrides: SetArgs,

    /// Save the first wrong answers, by backend, verdict and source of rays, with their packets
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath)]
    pub save: Option<PathBuf>,

    /// Trace the rays of a saved file again, in the scene that it contains
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath, conflicts_with_all = ["input", "no_picture", "save", "rays", "seed", "size", "spp", "set", "backends"])]
    pub replay: Option<PathBuf>,

    #[command(flatten)]
    pub kernels: KernelArgs,

    #[command(flatten)]
    pub workers: WorkerArgs,

    /// Print the result as one JSON object
    #[arg(long)]
    pub json: bool,
}
