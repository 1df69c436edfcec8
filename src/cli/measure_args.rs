//! Arguments of the commands that measure: `bench`, `crosscheck`, `accuracy`, `compare`,
//! `converge`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use super::names::{IsaName, SamplerName, ToneName};
use crate::{scene::written::Accelerator, units::parse_size};

/// Arguments of `lightpath crosscheck`.
#[derive(Debug, Args)]
pub struct CrosscheckArgs {
    /// A scene.json, a mesh.ply (in the built-in studio), or - for a scene on stdin
    #[arg(value_name = "SCENE|FILE.ply|-", value_hint = ValueHint::FilePath, required_unless_present = "replay")]
    pub input: Option<PathBuf>,

    /// Two or more backends [default: all that can run on this machine]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Option<Vec<Accelerator>>,

    /// Number of rays to check, in equal shares per kind; kinds that the scene lacks are left out
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,

    /// Seed of the scene and of the random rays [default: the scene's]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    /// Do not render and compare pictures
    #[arg(long)]
    pub no_picture: bool,

    /// Picture size in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,

    /// Camera samples per pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub spp: Option<u32>,

    /// Set any value of the scene; VALUE is JSON, or else a string; repeatable
    #[arg(long, value_name = "/json/pointer=VALUE")]
    pub set: Vec<String>,

    /// Save the first wrong answers of each backend, kind and class of rays, with their packets
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath)]
    pub save: Option<PathBuf>,

    /// Trace the rays of a saved file again, in the scene that it contains
    #[arg(long, value_name = "FILE.json", value_hint = ValueHint::FilePath, conflicts_with_all = ["input", "no_picture", "save", "rays", "seed", "size", "spp", "set", "backends"])]
    pub replay: Option<PathBuf>,

    /// Instruction set of our own kernels [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<IsaName>,

    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,

    /// Print the result as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `lightpath bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Scenes, or meshes in the built-in scene: ground, one point light and one area light
    #[arg(required = true, value_name = "SCENE|FILE.ply", value_hint = ValueHint::FilePath)]
    pub inputs: Vec<PathBuf>,

    /// Backends to compare: bvh, embree, embree-fast, embree-compact, coursework, brute; bvh:TIER
    /// forces an instruction set (portable, avx2, avx512). All are compared with the first
    /// [default: embree,bvh; bvh alone without Embree]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Vec<String>,

    /// Classes of rays: primary, shadow-point, shadow-area, mirror, diffuse [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub classes: Vec<String>,

    /// Instruction set of our own kernels [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<IsaName>,

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

    /// A small picture, few rays, few rounds: shows that it works, not how fast it is
    #[arg(long, conflicts_with_all = ["seconds", "rounds", "rays", "size"])]
    pub quick: bool,

    /// Picture size in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,

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

    /// Only errors on stderr
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `lightpath accuracy`.
#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Backends to measure: bvh (each instruction set of this machine), bvh:portable, bvh:avx2,
    /// bvh:avx512, embree, embree-fast, embree-compact, coursework, brute [default: all that can
    /// run here, without embree-compact]
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

    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,

    /// Write all results as JSON
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub json: Option<PathBuf>,

    /// Write one page with the table and pictures of failures
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    /// Write the table as a page of documentation
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub markdown: Option<PathBuf>,

    /// Only errors on stderr
    #[arg(long)]
    pub quiet: bool,
}

/// Arguments of `lightpath compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture to test: EXR or PNG
    #[arg(value_name = "A", value_hint = ValueHint::FilePath)]
    pub test: PathBuf,

    /// The reference picture
    #[arg(value_name = "B", value_hint = ValueHint::FilePath)]
    pub reference: PathBuf,

    /// Compare only this layer; `beauty` is the picture itself; repeatable [default: all layers
    /// that both files have]
    #[arg(long, value_name = "NAME")]
    pub layer: Vec<String>,

    /// Exit 1 if a layer's error is above VALUE, e.g. relmse=1e-3; repeatable
    #[arg(long, value_name = "METRIC=VALUE")]
    pub fail_above: Vec<String>,

    /// Exit 1 if a layer's psnr or ssim is below VALUE; repeatable
    #[arg(long, value_name = "METRIC=VALUE")]
    pub fail_below: Vec<String>,

    /// Tone curve of the 8-bit pictures for psnr, ssim and flip [default: max by B's largest value;
    /// clamp if a file is a PNG]
    #[arg(long, value_name = "OP")]
    pub tonemap: Option<ToneName>,

    /// Exposure of the 8-bit pictures in stops
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true, default_value_t = 0.0)]
    pub exposure: f32,

    /// Write the first layer's error map in false colour
    #[arg(long, value_name = "FILE.png", value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,

    /// Write one page with the pictures, their error maps and all numbers
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    /// Print the result as one JSON object
    #[arg(long)]
    pub json: bool,

    /// Print no numbers, only names of written files and failures
    #[arg(long, conflicts_with = "json")]
    pub quiet: bool,

    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

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

    /// Some of bvh, bvh:portable, bvh:avx2, bvh:avx512, embree, embree-fast, embree-compact,
    /// coursework, brute; the first one renders the reference [default: the scene's]
    #[arg(long, visible_alias = "backend", value_name = "NAME,...", value_delimiter = ',')]
    pub backends: Vec<String>,

    /// How sample points are chosen
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = "sobol,random")]
    pub sampler: Vec<SamplerName>,

    /// Camera samples per pixel; 1 is not antialiased
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_value = "1,4,16,64", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: Vec<u32>,

    /// Samples on every area light per shading point [default: 1,4,16 if there are area lights]
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub light_samples: Vec<u32>,

    /// Renders per setting, each with its own seed
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeats: u32,

    /// Seconds for the whole study, loading and reference included; settings that do not fit are
    /// left out and listed
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0, allow_negative_numbers = true)]
    pub budget: f64,

    /// First seed [default: 0, or one more than the seed of the --reference]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    /// Picture size in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,

    /// Set any value of the scene; VALUE is JSON, or else a string; repeatable
    #[arg(long, value_name = "/json/pointer=VALUE")]
    pub set: Vec<String>,

    /// Instruction set of our own kernels [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<IsaName>,

    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,

    /// Write all results, with every time, as JSON
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub json: Option<PathBuf>,

    /// Write a table of all settings
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub csv: Option<PathBuf>,

    /// Write one page with charts and pictures
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub html: Option<PathBuf>,

    /// Only errors on stderr
    #[arg(long)]
    pub quiet: bool,
}
