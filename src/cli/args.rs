//! The table of commands and flags. Help, completions and the man page are generated from it.

use clap::{Parser, Subcommand, ValueEnum};

use super::accuracy::args::AccuracyArgs;
use super::batch::args::BatchArgs;
use super::bench::args::BenchArgs;
use super::compare::args::CompareArgs;
use super::converge::args::ConvergeArgs;
use super::crosscheck::args::CrosscheckArgs;
use super::info::args::InfoArgs;
use super::merge::MergeArgs;
use super::render::args::RenderArgs;
use super::submit::SubmitArgs;

/// Text below the help of every command that can fail in several ways.
pub const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 a check failed, in a batch an input; 2 bad use or bad input; 3 a failure \
worth retrying (disk full, out of memory); 130, 143, 129, 131, 152 stopped by SIGINT, SIGTERM, \
SIGHUP, SIGQUIT, SIGXCPU. Results go to stdout, messages to stderr.";

/// CPU ray tracer for big scanned meshes: scene.json or scan.ply -> EXR and PNG.
#[derive(Debug, Parser)]
#[command(
    name = "lightpath",
    disable_version_flag = true,
    args_conflicts_with_subcommands = true,
    arg_required_else_help = true,
    after_help = EXIT_CODES,
    max_term_width = 100
)]
pub struct Arguments {
    /// Print the version
    #[arg(short = 'V', long)]
    pub version: bool,

    /// With --version: commit, compiler, Embree, instruction sets
    #[arg(short, long, requires = "version")]
    pub verbose: bool,

    /// The command to run.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// A command with its arguments.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene or a mesh to PREFIX.exr and PREFIX.png
    #[command(after_help = EXIT_CODES)]
    Render(Box<RenderArgs>),
    /// Render many meshes and scenes: turntables, resume, contact sheet
    #[command(after_help = EXIT_CODES, mut_arg("crop", |crop| crop.hide(true)))]
    Batch(Box<BatchArgs>),
    /// Check scenes without rendering; describe PLY and EXR files
    #[command(after_help = EXIT_CODES)]
    Info(InfoArgs),
    /// Compare the speed and the answers of backends on the same rays
    #[command(after_help = EXIT_CODES)]
    Bench(Box<BenchArgs>),
    /// Check every backend's answers, ray by ray, against an exact oracle
    #[command(after_help = EXIT_CODES)]
    Crosscheck(Box<CrosscheckArgs>),
    /// Run the hard cases on every backend and compare with exact answers
    #[command(after_help = EXIT_CODES)]
    Accuracy(Box<AccuracyArgs>),
    /// Measure how far a picture is from a reference: metrics, error maps, thresholds
    #[command(after_help = EXIT_CODES)]
    Compare(Box<CompareArgs>),
    /// Measure error against time: samplers, numbers of samples and backends against a reference
    #[command(after_help = EXIT_CODES)]
    Converge(Box<ConvergeArgs>),
    /// Merge the parts of a picture into the files that one render would write
    #[command(after_help = EXIT_CODES)]
    Merge(MergeArgs),
    /// Submit a batch to a cluster
    #[command(after_help = EXIT_CODES)]
    Submit(SubmitArgs),
    /// Print the JSON Schema of scene files, or of the job files of `batch`
    Schema {
        /// Which kind of file
        #[arg(default_value = "scene")]
        of: SchemaName,
    },
    /// Print a shell completion script
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page (troff)
    Man,
}

/// Kinds of files that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SchemaName {
    /// Scene files
    Scene,
    /// Job files of `batch`
    Job,
}
