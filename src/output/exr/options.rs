//! What an EXR holds beside the film, and how it is encoded.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::film::ChannelKind;
use crate::output::value_counts::HALF_MAX;

/// Largest absolute value that DWAA's lossy channels are given, so that no decoded value is
/// infinite.
///
/// The codec rounds 1 + ln(v) / 2.2 to a half, converts R, G, B to luma and chroma, and rounds the
/// coefficients of an orthonormal 8 x 8 DCT to halves, then to quantised halves. The worst errors
/// of a decoded curve value add up, for B, whose errors are those of luma plus 1.8556 times those
/// of a chroma:
/// - 0.0502 from the quantisation: the largest sum over a block of tolerance times basis function;
///   the tolerances are 45e-5 times an entry of JPEG's tables over the least entry (10 or 17);
/// - 0.0661 from coefficients as halves: 2^-11 times the sum of coefficient times basis function,
///   which is at most 8 times the curve's largest value, 5.92;
/// - 0.0040 from the halves before and after.
///
/// So 50,000 becomes at most 50,000 exp(2.2 * 0.1203) = 65,150, less than 65,520, from where halves
/// are infinite.
pub const DWA_MAX: f32 = 50_000.0;

/// Compression of the blocks.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// zlib over blocks of 16 lines.
    #[default]
    Zip,
    /// zlib over single lines.
    Zips,
    /// Wavelets, OpenEXR's PIZ: good for grain.
    Piz,
    /// Run lengths of bytes.
    Rle,
    /// No compression at all.
    None,
    /// DWAA over 32 lines, lossy and small: a DCT of halves for channels named R, G, B or Y,
    /// lossless for all others.
    Dwaa,
}

impl Compression {
    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Zip => "zip",
            Self::Zips => "zips",
            Self::Piz => "piz",
            Self::Rle => "rle",
            Self::None => "none",
            Self::Dwaa => "dwaa",
        }
    }

    /// Returns true if the method changes values.
    pub fn is_lossy(self) -> bool {
        self == Self::Dwaa
    }

    /// Returns true if the method changes the values of a channel, which it keeps as halves,
    /// whatever its type.
    fn changes(self, channel: &str) -> bool {
        let axis = channel.rsplit('.').next().unwrap_or_default();
        self == Self::Dwaa && ["R", "G", "B", "Y"].contains(&axis)
    }
}

/// The camera in OpenEXR's convention: row vectors times matrices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMatrices {
    /// World to camera space: x right, y up, z forward.
    pub world_to_camera: [f32; 16],
    /// World to normalised device coordinates: (0, 0) top left, (1, 1) bottom right of the frame.
    /// `None` for a camera that no matrix expresses.
    pub world_to_ndc: Option<[f32; 16]>,
    /// Width of the frame at distance 1.
    pub screen_window_width: f32,
    /// Centre of the frame at distance 1: x right, y up.
    pub screen_window_center: [f32; 2],
    /// Width of a pixel over its height.
    pub pixel_aspect: f32,
}

/// The position of a picture in a sequence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sequence {
    /// Frame number: `imageCounter`.
    pub frame: Option<i32>,
    /// Frames per second as a fraction, e.g. 24000 / 1001: `framesPerSecond`.
    pub per_second: Option<(i32, u32)>,
}

/// Metadata and encoding of an EXR.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Custom text attributes: name and value.
    pub attributes: &'a [(String, String)],
    /// The camera, for the standard attributes.
    pub view: Option<CameraMatrices>,
    /// The position of the picture in a sequence.
    pub sequence: Sequence,
    /// Render time in seconds: `renderTimeSeconds`. It differs from run to run.
    pub render_seconds: Option<f32>,
    /// True for 32-bit floats in place of halves.
    pub float: bool,
    /// True if floats that are not finite keep their bits, as in the part of a picture.
    pub exact: bool,
    /// Compression of the blocks.
    pub compression: Compression,
    /// True for one part of the file per layer.
    pub multipart: bool,
}

impl Options<'_> {
    /// Returns the largest absolute value that the file holds in a channel, by the compression and
    /// the channel's type.
    pub fn largest(&self, channel: &str, kind: ChannelKind) -> f32 {
        if self.compression.changes(channel) {
            DWA_MAX
        } else if kind == ChannelKind::Half && !self.float {
            HALF_MAX
        } else {
            f32::MAX
        }
    }
}
