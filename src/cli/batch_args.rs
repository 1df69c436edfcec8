//! The flags of `lightpath batch`.

use std::{ops::Range, path::PathBuf};

use clap::{Args, ValueHint};

use crate::{
    output::{exr::Compression, tonemap::Depth},
    units::{parse_angles, parse_margin, parse_point, parse_range, parse_rate},
};

use super::args::{LookArgs, MachineArgs, SceneArgs};
use super::names::{Axis, FixedName, ProgressMode, TurningName};

/// `lightpath batch`
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// Scenes, meshes, folders of them; or one job file (JSON with `inputs`: `lightpath schema job`)
    #[arg(required = true, value_name = "INPUT", value_hint = ValueHint::AnyPath)]
    pub inputs: Vec<PathBuf>,

    /// The folder that everything goes to [default: the job's, else out]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,

    /// Names in it, of {stem} {parent} {input:03} {frame:04} [default: {stem}, or
    /// {stem}/{stem}.{frame:04} of a turntable]
    #[arg(long, value_name = "PATTERN")]
    pub name: Option<String>,

    /// Which frames.
    #[command(flatten)]
    pub frames: FrameArgs,

    /// How meshes are shown.
    #[command(flatten)]
    pub mesh: BatchMeshArgs,

    /// Changes to every scene.
    #[command(flatten)]
    pub scene: SceneArgs,

    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,

    /// Resources.
    #[command(flatten)]
    pub machine: MachineArgs,

    /// Only errors on stderr
    #[arg(long, conflicts_with = "progress", help_heading = "Messages")]
    pub quiet: bool,

    /// Progress of all frames together; auto is a bar on a terminal, else plain
    #[arg(long, value_name = "MODE", help_heading = "Messages")]
    pub progress: Option<ProgressMode>,
}

/// Flags for frames.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Frames")]
pub struct FrameArgs {
    /// N frames from around, evenly, with one framing for all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub turntable: Option<u32>,

    /// What turns [default: object]
    #[arg(long, value_name = "WHAT", requires = "turntable")]
    pub turn: Option<TurningName>,

    /// What the lights stay with [default: camera if the object turns, object if the camera does]
    #[arg(long, value_name = "WHAT", requires = "turntable")]
    pub lights: Option<FixedName>,

    /// Angle of the first frame in degrees
    #[arg(long, value_name = "DEG", requires = "turntable", allow_negative_numbers = true)]
    pub start: Option<f64>,

    /// A point of the turntable's axis [default: the middle of a mesh, the target of a scene's camera]
    #[arg(long, value_name = "X,Y,Z", requires = "turntable", value_parser = parse_point, allow_hyphen_values = true)]
    pub pivot: Option<[f64; 3]>,

    /// Only frames A to B - 1 of all frames, mesh after mesh, counted from 0
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    pub range: Option<Range<u64>>,

    /// 32-bit floats in the EXR in place of halves
    #[arg(long)]
    pub float: bool,

    /// Compression of the EXR; dwaa is lossy
    #[arg(long, value_name = "NAME")]
    pub compression: Option<Compression>,

    /// A part of the EXR for every layer
    #[arg(long)]
    pub multipart: bool,

    /// Bits of the PNGs' channels [default: 8]
    #[arg(long, value_name = "BITS")]
    pub png_bits: Option<Depth>,

    /// Write the names of cryptomattes to NAME.CryptoObject.json and NAME.CryptoMaterial.json in
    /// place of the EXR's header
    #[arg(long)]
    pub crypto_sidecar: bool,

    /// Frames per second, for the EXRs: 24 or 24000/1001
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub fps: Option<(i32, u32)>,
}

/// Flags for meshes.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Meshes")]
pub struct BatchMeshArgs {
    /// Show meshes in this scene instead of the built-in studio; its first trimesh is replaced
    #[arg(long, value_name = "SCENE", value_hint = ValueHint::FilePath)]
    pub template: Option<PathBuf>,

    /// Which axis of the meshes points up [default: y]
    #[arg(long, value_name = "AXIS")]
    pub up: Option<Axis>,

    /// Turn the meshes by degrees about their x, then y, then z axis, in place of --up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_angles, allow_hyphen_values = true, conflicts_with = "up")]
    pub rotate: Option<[f64; 3]>,

    /// Kept free around a mesh at each border, as a fraction of the picture [default: 0.08]
    #[arg(long, value_name = "FRACTION", value_parser = parse_margin, allow_negative_numbers = true)]
    pub margin: Option<f64>,

    #[command(flatten)]
    pub looks: LookArgs,

    /// Drop triangles that use missing or non-finite vertices instead of refusing the mesh
    #[arg(long)]
    pub repair: bool,

    /// Read mesh files instead of mapping them into memory
    #[arg(long)]
    pub no_mmap: bool,
}

/// Flags for the run.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Run")]
pub struct RunArgs {
    /// Keep frames that are as they were written, from the same scene, files, settings and version
    #[arg(long, visible_alias = "skip-existing")]
    pub resume: bool,

    /// With --resume: keep frames without reading all of their bytes
    #[arg(long, requires = "resume")]
    pub no_verify: bool,

    /// Begin nothing new after the first failure
    #[arg(long)]
    pub fail_fast: bool,

    /// Frames rendered at a time [default: 1, more of small ones]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,

    /// List the frames, one JSON object per line, and render nothing
    #[arg(long)]
    pub dry_run: bool,

    /// Write no contact sheet (index.html, sheet.png)
    #[arg(long)]
    pub no_sheet: bool,

    /// Write the contact sheet of what is there and render nothing
    #[arg(long, conflicts_with_all = ["dry_run", "no_sheet", "range"])]
    pub sheet_only: bool,
}
