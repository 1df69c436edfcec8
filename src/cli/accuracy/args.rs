//! Arguments of `lightpath accuracy`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::cli::flags::{MessageArgs, WorkerArgs};

/// Arguments of `lightpath accuracy`.
#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Backends to measure: bvh (each instruction set of this machine), bvh:portable, bvh:neon,
    /// bvh:avx2, bvh:avx512, embree, embree-fast, embree-compact, coursework, brute [default: all
    /// that can run here, without embree-compact]
    #[arg(long, visible_alias = "backends", value_name = "NAME,...", value_delimiter = ',')]
    pub backend: Vec<String>,

    /// Take less than a minute; the default
    #[arg(long)]
    pub quick: bool,

    /// Trace some 10^8 rays: 400 times those of --quick
    #[arg(long, conflicts_with = "quick")]
    pub full: bool,

    /// Trace N times the rays of --quick
    #[arg(long, value_name = "N", conflicts_with_all = ["quick", "full"], value_parser = clap::value_parser!(u64).range(1..=4000))]
    pub times: Option<u64>,

    /// Run only cases whose group or name contains TEXT
    #[arg(long, value_name = "TEXT")]
    pub case: Option<String>,

    /// Seed of all random rays
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,

    #[command(flatten)]
    pub workers: WorkerArgs,

    /// Write all results as JSON
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub json: Option<PathBuf>,

    /// Write one page with the table and pictures of failures
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    /// Write the table as a page of documentation
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub markdown: Option<PathBuf>,

    #[command(flatten)]
    pub messages: MessageArgs,
}
