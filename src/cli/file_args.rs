//! Flags of `render` for its output files.

use clap::Args;

use crate::{
    output::{
        exr::{Compression, Sequence},
        tonemap::Depth,
    },
    picture::Storage,
    units::parse_rate,
};

/// Flags for output files.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Files")]
pub struct FileArgs {
    /// Write one part of the EXR per layer
    #[arg(long)]
    pub multipart: bool,

    /// Number of the frame in a sequence, for the EXR's imageCounter
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frame: Option<i32>,

    /// Frame rate for the EXR: 24 or 24000/1001
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub fps: Option<(i32, u32)>,

    /// Write the render time into the EXR; its bytes then differ from run to run
    #[arg(long)]
    pub record_time: bool,

    /// Store 32-bit floats in the EXR instead of 16-bit floats
    #[arg(long)]
    pub float: bool,

    /// Compression of the EXR; dwaa is lossy
    #[arg(long, value_name = "NAME")]
    pub compression: Option<Compression>,

    /// Bits per channel of the PNG [default: 8]
    #[arg(long, value_name = "BITS")]
    pub png_bits: Option<Depth>,

    /// Write layers of the EXR as pictures, too: PREFIX.NAME.png each; `all` for every layer
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub png_layer: Vec<String>,

    /// Write the object names of cryptomattes to PREFIX.CryptoObject.json and
    /// PREFIX.CryptoMaterial.json instead of the EXR's header
    #[arg(long)]
    pub crypto_sidecar: bool,

    /// Fail (exit code 1) if a pixel is NaN or infinite; the files are written all the same
    #[arg(long)]
    pub strict: bool,
}

impl FileArgs {
    /// Returns frame number and frame rate for the EXR header.
    pub fn sequence(&self) -> Sequence {
        Sequence { frame: self.frame, per_second: self.fps }
    }

    /// Returns the format of the pictures.
    pub fn storage(&self) -> Storage {
        Storage {
            float: self.float,
            compression: self.compression.unwrap_or_default(),
            multipart: self.multipart,
            depth: self.png_bits.unwrap_or_default(),
            crypto_sidecar: self.crypto_sidecar,
        }
    }
}
