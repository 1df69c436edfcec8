//! The flags of `lightpath batch`.

use std::ops::Range;
use std::path::PathBuf;

use clap::{Arg, Args, ValueHint};

use crate::cli::flags::{
    ExrArgs, LookArgs, MachineArgs, MeshReadArgs, MultipartArgs, NoiseArgs, PlacementArgs,
    SceneArgs,
};
use crate::cli::progress::ProgressMode;
use crate::output::tonemap::Depth;
use crate::studio::{LightsFollow, Turning};
use crate::units::{parse_point, parse_range, parse_rate};

/// Arguments of `lightpath batch`.
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// Scenes, meshes and folders of them; or one job file (JSON with `inputs`: `lightpath schema
    /// job`)
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,

    /// Output folder [default: the job's, else out in the working folder]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,

    /// Pattern of file names, with {stem} {parent} {input:03} {frame:04} {image} [default:
    /// {stem}, {stem}/{stem}.{frame:04} for a turntable, {stem}/{image} for --cameras]
    #[arg(long, value_name = "PATTERN")]
    pub name: Option<String>,

    #[command(flatten)]
    pub frames: FrameArgs,

    #[command(flatten)]
    pub mesh: BatchMeshArgs,

    #[command(flatten)]
    pub scene: SceneArgs,

    #[command(flatten)]
    pub sampling: BatchSamplingArgs,

    #[command(flatten)]
    pub run: RunArgs,

    #[command(flatten)]
    pub machine: MachineArgs,

    /// Only errors on stderr, and what --progress asks for
    #[arg(long, help_heading = "Messages")]
    pub quiet: bool,

    /// Progress of all frames together; auto is a bar on a terminal, else plain
    #[arg(long, value_name = "MODE", help_heading = "Messages")]
    pub progress: Option<ProgressMode>,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Frames")]
pub struct FrameArgs {
    /// Render N frames evenly spread over one turn, all with the same framing
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub turntable: Option<u32>,

    /// Turn the object or the camera [default: object]
    #[arg(long, value_name = "WHAT", requires = "turntable", conflicts_with = "cameras")]
    pub turn: Option<Turning>,

    /// Keep the lights fixed to the camera or to the object [default: camera if the object turns,
    /// object if the camera turns]
    #[arg(long, value_name = "WHAT", requires = "turntable", conflicts_with = "cameras")]
    pub lights: Option<LightsFollow>,

    /// Angle of the first frame in degrees, from -360 to 360
    #[arg(long, value_name = "DEG", requires = "turntable", conflicts_with = "cameras", value_parser = parse_start, allow_negative_numbers = true)]
    pub start: Option<f64>,

    /// Render each input from every camera of a list, in its own coordinates: a folder with a
    /// COLMAP model, transforms.json, or JSON with `cameras`
    #[arg(long, value_name = "FILE", conflicts_with = "turntable", value_hint = ValueHint::AnyPath)]
    pub cameras: Option<PathBuf>,

    /// With --cameras: ignore the distortion of the lenses
    #[arg(long)]
    pub undistort: bool,

    /// A point on the turntable's axis [default: the middle of a mesh, the target of a scene's
    /// camera]
    #[arg(long, value_name = "X,Y,Z", requires = "turntable", conflicts_with = "cameras", value_parser = parse_point, allow_hyphen_values = true)]
    pub pivot: Option<[f64; 3]>,

    /// Render only frames A to B - 1, counted from 0 over all frames, mesh after mesh
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    pub range: Option<Range<u64>>,

    #[command(flatten)]
    pub values: ExrArgs,

    #[command(flatten)]
    pub parts: MultipartArgs,

    /// Bits per channel of the PNGs [default: 8]
    #[arg(long, value_name = "BITS")]
    pub png_bits: Option<Depth>,

    /// Write the object names of cryptomattes to NAME.CryptoObject.json and
    /// NAME.CryptoMaterial.json instead of the EXR's header
    #[arg(long)]
    pub crypto_sidecar: bool,

    /// A frame with a NaN or infinite pixel fails (exit code 1) and is not written
    #[arg(long)]
    pub strict: bool,

    /// Frame rate for the EXRs: 24 or 24000/1001
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub fps: Option<(i32, u32)>,
}

/// Flags for meshes without a scene.
#[derive(Debug, Args)]
#[command(next_help_heading = "Meshes", mut_args = of_meshes)]
pub struct BatchMeshArgs {
    /// Show meshes in this scene instead of the built-in studio; its first trimesh is replaced
    #[arg(long, value_name = "SCENE", value_hint = ValueHint::FilePath)]
    pub template: Option<PathBuf>,

    #[command(flatten)]
    pub placement: PlacementArgs,

    #[command(flatten)]
    pub looks: LookArgs,

    #[command(flatten)]
    pub reading: MeshReadArgs,
}

/// Flags for the number of samples of each pixel.
#[derive(Debug, Args)]
#[command(next_help_heading = "Sampling", mut_args = without_time)]
pub struct BatchSamplingArgs {
    #[command(flatten)]
    pub noise: NoiseArgs,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Run")]
pub struct RunArgs {
    /// Keep frames whose files are unchanged and come from the same scene, files, settings and
    /// version
    #[arg(long, visible_alias = "skip-existing")]
    pub resume: bool,

    /// With --resume: keep frames without reading all their bytes
    #[arg(long, requires = "resume")]
    pub no_verify: bool,

    /// Start nothing new after the first failure
    #[arg(long)]
    pub fail_fast: bool,

    /// Number of frames rendered at a time [default: 1, more if frames are small]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,

    /// List the frames, one JSON object per line; render nothing
    #[arg(long)]
    pub dry_run: bool,

    /// Write no contact sheet (index.html, sheet.png)
    #[arg(long)]
    pub no_sheet: bool,

    /// Write the contact sheet of the existing frames; render nothing
    #[arg(long, conflicts_with_all = ["dry_run", "no_sheet", "range"])]
    pub sheet_only: bool,
}

/// Parses the angle of a turntable's first frame, within the range of the job file.
fn parse_start(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (-360.0..=360.0).contains(degrees));
    degrees.ok_or_else(|| "expected a number in [-360, 360]".to_string())
}

/// Rewords the help of [`NoiseArgs`]: a batch has no `--time`.
fn without_time(arg: Arg) -> Arg {
    match arg.get_id().as_str() {
        "max_spp" => arg.help(
            "Maximum number of samples per pixel with --noise, a power of two [default: 4096]",
        ),
        _ => arg,
    }
}

/// Rewords the help of [`PlacementArgs`] for many meshes.
fn of_meshes(arg: Arg) -> Arg {
    let help = match arg.get_id().as_str() {
        "up" => "Which axis of the meshes points up [default: y]",
        "rotate" => {
            "Rotate the meshes by degrees about their x, then y, then z axis, in place of --up"
        }
        "margin" => {
            "Free space around a mesh at each border, as a fraction of the picture [default: 0.08]"
        }
        _ => return arg,
    };
    arg.help(help)
}
