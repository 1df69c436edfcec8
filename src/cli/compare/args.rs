//! Arguments of `lightpath compare`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::cli::flags::WorkerArgs;
use crate::scene::ToneOperator;

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
    pub tonemap: Option<ToneOperator>,

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

    #[command(flatten)]
    pub workers: WorkerArgs,
}
