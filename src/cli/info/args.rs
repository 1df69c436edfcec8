//! Arguments of `lightpath info`.

use std::path::PathBuf;

use clap::{Args, ValueHint};

use crate::scene::written::AcceleratorName;

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

    /// List of cameras, as for `batch --cameras`: print their positions, and how much of each mesh
    /// they see
    #[arg(long, value_name = "PATH", value_hint = ValueHint::AnyPath)]
    pub cameras: Option<PathBuf>,

    /// Backend whose memory is predicted [default: the scene's]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<AcceleratorName>,
}
