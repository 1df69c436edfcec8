//! The table of commands and flags. Help, completions and the man page are generated from it.

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueHint};

use crate::{
    scene::written::Accelerator,
    studio::{Appearance, Subject, smooth},
    units::{parse_angles, parse_bytes, parse_margin, parse_size, parse_smooth},
};

pub use super::batch::args::BatchArgs;
pub use super::file_args::FileArgs;
pub use super::measure_args::{AccuracyArgs, BenchArgs, CompareArgs, ConvergeArgs, CrosscheckArgs};
pub use super::merge::MergeArgs;
pub use super::names::{Axis, IsaName, NoiseOf, ProgressMode, SamplerName, SchemaName, ToneName};
pub use super::render::part::SplitArgs;
pub use super::submit::SubmitArgs;

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 a check failed; 2 bad use or bad input; 3 a failure worth retrying (disk full, \
out of memory); 130/143 stopped by SIGINT/SIGTERM. Results go to stdout, messages to stderr.";

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
    #[command(after_help = EXIT_CODES)]
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
    /// Merge the parts of a picture: the same bytes as by one render
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

/// Arguments of `lightpath render`.
#[derive(Debug, Default, Args)]
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

/// Flags that change the scene.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Scene (overrides values of the file)")]
pub struct SceneArgs {
    /// Picture size in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,

    /// Camera samples per pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub spp: Option<u32>,

    /// Samples on every area light per shading point
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub light_samples: Option<u32>,

    /// Trace a quarter of an area light's shadow rays first, and the rest only if these disagree or
    /// a randomly drawn point contradicts them: fewer rays, the same mean
    #[arg(long)]
    pub adaptive_shadows: bool,

    /// Maximum number of mirror bounces after the primary ray
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub nbounces: Option<u32>,

    /// Seed of all random choices
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    /// How sample points are chosen
    #[arg(long, value_name = "NAME")]
    pub sampler: Option<SamplerName>,

    /// Exposure of the PNG in stops
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    pub exposure: Option<f64>,

    /// Tone curve of the PNG
    #[arg(long, value_name = "OP")]
    pub tonemap: Option<ToneName>,

    /// Full vertical angle of view in degrees
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub fov: Option<f64>,

    /// Backend that traces the rays [default: the scene's, else bvh]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<Accelerator>,

    /// Write coverage to alpha instead of 1, without the background
    #[arg(long)]
    pub transparent: bool,

    /// Layers of the EXR: Z, P, N, Ng, albedo, uv, diffuse, specular, ambient, reflection,
    /// background, light_GROUP, shadow_GROUP, variance, samples, primid, objectid, cryptomatte...
    /// or all
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub aov: Option<Vec<String>>,

    /// Number of objects that one pixel of a cryptomatte can hold: 2, 4... 16 [default: 6]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub crypto_ranks: Option<i64>,

    /// Set any value of the scene; VALUE is JSON, or else a string; repeatable, wins over flags
    #[arg(long, value_name = "/json/pointer=VALUE")]
    pub set: Vec<String>,

    /// Render only these pixels, from the top left; X1 and Y1 are excluded
    #[arg(long, num_args = 4, allow_negative_numbers = true, value_names = ["X0", "Y0", "X1", "Y1"])]
    pub crop: Option<Vec<u32>>,

    /// Render PX more pixels on every side of the frame; the EXR's display window stays the frame
    #[arg(long, value_name = "PX", conflicts_with = "crop", value_parser = clap::value_parser!(u32).range(..=65536), default_value_t)]
    pub overscan: u32,
}

/// Flags for the number of samples of each pixel.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Sampling")]
pub struct SamplingArgs {
    /// Take more samples where the relative standard error around a pixel is above TARGET, e.g.
    /// 0.02; every pixel gets --spp samples (16 at least)
    #[arg(long, value_name = "TARGET", allow_negative_numbers = true)]
    pub noise: Option<f64>,

    /// What the error is relative to [default: pixel]
    #[arg(long, value_name = "OF", requires = "noise")]
    pub noise_of: Option<NoiseOf>,

    /// Maximum number of samples per pixel with --noise or --time, a power of two [default: 4096
    /// with --noise, else 65536]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub max_spp: Option<u32>,

    /// Take more samples until rendering has taken SECONDS; the picture is not reproducible
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub time: Option<f64>,
}

#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Meshes")]
pub struct MeshArgs {
    /// Which axis of the .ply points up [default: y]
    #[arg(long, value_name = "AXIS")]
    pub up: Option<Axis>,

    /// Rotate the .ply by degrees about its x, then y, then z axis, in place of --up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_angles, allow_hyphen_values = true, conflicts_with = "up")]
    pub rotate: Option<[f64; 3]>,

    /// Free space around the mesh at each border, as a fraction of the picture [default: 0.08]
    #[arg(long, value_name = "FRACTION", value_parser = parse_margin, allow_negative_numbers = true)]
    pub margin: Option<f64>,

    /// Show the .ply in this scene instead of the built-in studio; its first trimesh is replaced
    #[arg(long, value_name = "SCENE", value_hint = ValueHint::FilePath)]
    pub template: Option<PathBuf>,

    #[command(flatten)]
    pub looks: LookArgs,

    /// Save the scene that is rendered, overrides and framing included
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub write_scene: Option<PathBuf>,

    /// Drop triangles that use missing or non-finite vertices instead of refusing the mesh
    #[arg(long)]
    pub repair: bool,

    /// Read mesh files instead of mapping them into memory
    #[arg(long)]
    pub no_mmap: bool,
}

/// Flags for the look of meshes.
#[derive(Debug, Default, Args)]
pub struct LookArgs {
    /// Interpolate normals of the .ply across edges of at most DEGREES, across all edges or none
    /// [default: the template's; in the studio 57, between flat parts 44]
    #[arg(long, value_name = "DEGREES|all|off", value_parser = parse_smooth, allow_negative_numbers = true)]
    pub smooth: Option<f64>,

    /// Image for the texture coordinates of the .ply
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub texture: Option<PathBuf>,

    /// Remove the plane named `ground`; the studio's is always removed under --transparent
    #[arg(long)]
    pub no_ground: bool,
}

impl LookArgs {
    /// Converts the flags to [`Appearance`].
    pub fn of(&self) -> Appearance {
        Appearance {
            smooth: self.smooth.map(smooth),
            texture: self.texture.clone(),
            no_ground: self.no_ground,
        }
    }
}

#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Machine")]
pub struct MachineArgs {
    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,

    /// Use the fast mode of `embree`: a little faster, may miss hits on shared edges
    #[arg(long)]
    pub fast: bool,

    /// Instruction set of `bvh` and of shading [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<IsaName>,

    /// Refuse or stop rather than use more memory, e.g. 8G or 512MiB (G = GiB = 2^30)
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub max_memory: Option<u64>,
}

#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Messages")]
pub struct ReportArgs {
    /// Write times, rays and memory as JSON
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath)]
    pub stats: Option<PathBuf>,

    /// Print the statistics and the written paths as one JSON object on stdout
    #[arg(long)]
    pub json: bool,

    /// Only errors on stderr
    #[arg(long, conflicts_with = "progress")]
    pub quiet: bool,

    /// Progress on stderr; auto is a bar on a terminal, else plain
    #[arg(long, value_name = "MODE")]
    pub progress: Option<ProgressMode>,
}

/// Arguments of `lightpath info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Scenes, .ply and .exr files
    #[arg(required = true, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub files: Vec<PathBuf>,

    /// Print one JSON object per file and line
    #[arg(long)]
    pub json: bool,

    /// Read mesh files instead of mapping them into memory
    #[arg(long)]
    pub no_mmap: bool,

    /// Backend whose memory is predicted [default: the scene's]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<Accelerator>,
}

impl MeshArgs {
    /// Returns the mesh at `path` with the settings of these flags.
    pub fn subject<'a>(&self, path: &'a Path) -> Subject<'a> {
        let plain = Subject::new(path);
        Subject {
            up: self.up.map(Axis::studio),
            rotate: self.rotate,
            margin: self.margin.unwrap_or(plain.margin),
            looks: self.looks.of(),
            repair: self.repair,
            no_mmap: self.no_mmap,
            ..plain
        }
    }
}
