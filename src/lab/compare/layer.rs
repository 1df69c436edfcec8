//! Layers: channels of a picture that belong together and are compared together.

use std::path::Path;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::lab::named::named;
use crate::memory::limit_before_kill;
use crate::output::exr::layer_of;
use crate::reserve;

/// Largest number of bytes that the pixels of a file may take.
pub const MAX_BYTES: u64 = 4 << 30;
/// Estimated bytes that the comparison of a pixel of light takes, most of them for FLIP: 230 were
/// measured with both pictures (docs/notebook/measuring.md).
pub const WORKING_BYTES: u64 = 200;

named! {
    /// Meaning of the values of a layer.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Meaning {
        /// Linear light, R G B with BT.709 primaries.
        Light = "light",
        /// Other quantities with a meaningful difference, such as depth.
        Data = "data",
        /// Identifiers, which are only equal or not.
        Ids = "ids",
    }
}

/// Returns whether a part or layer of this name is the picture itself.
pub fn is_beauty(name: &str) -> bool {
    ["", "rgb", "rgba", "beauty"].iter().any(|known| name.eq_ignore_ascii_case(known))
}

/// Channels of a picture that are compared together.
#[derive(Debug, Clone)]
pub struct PictureLayer {
    /// Name of the layer; empty for the picture itself.
    pub name: String,
    /// Meaning of its values.
    pub meaning: Meaning,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Position of the top left pixel in the frame.
    pub origin: [i32; 2],
    /// Names of the channels, without the name of the layer.
    pub channels: Vec<String>,
    /// Values pixel by pixel, all channels of a pixel together, rows from the top.
    pub values: Vec<f32>,
    /// Whether any of its channels is stored in 16 bits.
    pub half: bool,
}

impl PictureLayer {
    /// Name of the layer in tables and messages: `beauty` for the picture itself.
    pub fn shown(&self) -> &str {
        if self.name.is_empty() { "beauty" } else { &self.name }
    }

    /// Returns whether `name` is the name of these channels or of the layer that they belong to.
    pub fn is_called(&self, name: &str) -> bool {
        [self.shown(), layer_of(self.shown())].contains(&name)
    }

    /// Number of values of a pixel: 3 of light, also of grey light.
    pub fn values_per_pixel(&self) -> usize {
        if self.meaning == Meaning::Light { 3 } else { self.channels.len() }
    }

    /// Position in the frame of the pixel `index` of the layer, counted in rows from the top.
    pub fn position(&self, index: usize) -> [i64; 2] {
        let at = [index % self.size[0], index / self.size[0]];
        [0, 1].map(|axis| i64::from(self.origin[axis]) + at[axis] as i64)
    }

    /// Returns whether the layer is light of a single channel in the file, used for R, G and B.
    pub fn is_grey(&self) -> bool {
        self.meaning == Meaning::Light && self.channels.len() == 1
    }
}

/// Returns an error `Limit` for more bytes than [`MAX_BYTES`].
pub fn fits(path: &Path, bytes: u64) -> Result<()> {
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    let message = format!("found {bytes} bytes of pixels, the limit is {MAX_BYTES}");
    Err(Error::new(ErrorKind::Limit, Problem::new(path.display().to_string(), message)))
}

/// Checks that the machine and the limits of the process leave `bytes` of memory. `what` names the
/// file that needs them.
///
/// # Errors
/// `Retry`, with the numbers.
pub fn has_room(what: &str, bytes: u64) -> Result<()> {
    limit_before_kill().map_or(Ok(()), |limit| limit.check(bytes, what))?;
    reserve::probe(bytes, what)
}
