//! What an EXR holds beside the film, and how it is encoded.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::film::ChannelKind;
use crate::output::value_counts::HALF_MAX;

/// Compression of the blocks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// zlib over blocks of 16 lines.
    #[default]
    Zip,
    /// zlib over single lines.
    Zips,
    /// Wavelet compression, OpenEXR's PIZ.
    Piz,
    /// Run lengths of bytes.
    Rle,
    /// No compression at all.
    None,
    /// DWAA over 32 lines: a lossy DCT of halves for channels named R, G, B or Y, lossless for all
    /// others.
    Dwaa,
}

impl Compression {
    /// All compressions that can be written.
    pub const ALL: &[Self] = &[Self::Zip, Self::Zips, Self::Piz, Self::Rle, Self::None, Self::Dwaa];

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

    /// Returns true if the method keeps the values of a channel as halves, whatever its type.
    fn halves(self, channel: &str) -> bool {
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
        let is_half = kind == ChannelKind::Half && !self.float;
        if is_half || self.compression.halves(channel) { HALF_MAX } else { f32::MAX }
    }
}
