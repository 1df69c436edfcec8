//! The flags of `render` for its files.

use clap::Args;

use crate::{
    output::{
        exr::{Compression, Sequence},
        tonemap::Depth,
    },
    picture::Storage,
    units::parse_rate,
};

/// Flags for the files.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Files")]
pub struct FileArgs {
    /// A part of the EXR for every layer
    #[arg(long)]
    pub multipart: bool,

    /// Number of the frame in a sequence, for the EXR's imageCounter
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frame: Option<i32>,

    /// Frames per second, for the EXR: 24 or 24000/1001
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub fps: Option<(i32, u32)>,

    /// Write the render's time into the EXR; two renders are no longer the same bytes
    #[arg(long)]
    pub record_time: bool,

    /// 32-bit floats in the EXR in place of halves
    #[arg(long)]
    pub float: bool,

    /// Compression of the EXR; dwaa is lossy
    #[arg(long, value_name = "NAME")]
    pub compression: Option<Compression>,

    /// Bits of the PNG's channels [default: 8]
    #[arg(long, value_name = "BITS")]
    pub png_bits: Option<Depth>,

    /// Show layers that are written as pictures: PREFIX.NAME.png each; all for every one
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub png_layer: Vec<String>,

    /// Write the names of cryptomattes to PREFIX.CryptoObject.json and PREFIX.CryptoMaterial.json
    /// in place of the EXR's header
    #[arg(long)]
    pub crypto_sidecar: bool,

    /// Fail (exit code 1) where a pixel was NaN or infinite; the files are written all the same
    #[arg(long)]
    pub strict: bool,
}

impl FileArgs {
    /// Which frame of a sequence it is.
    pub fn sequence(&self) -> Sequence {
        Sequence { frame: self.frame, per_second: self.fps }
    }

    /// How pictures are stored.
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
