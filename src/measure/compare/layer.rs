//! What is compared: channels of a picture that belong together.

use std::path::Path;

use crate::error::{Error, Kind, Problem, Result};

/// Most bytes that a file's pixels may take.
pub const MAX_BYTES: u64 = 4 << 30;

/// What the numbers of a layer are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    /// Linear BT.709 light, R G B.
    Light,
    /// Anything else that can be subtracted.
    Data,
    /// Numbers that are only equal or not.
    Ids,
}

impl Meaning {
    /// Name of the meaning in JSON and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Data => "data",
            Self::Ids => "ids",
        }
    }
}

/// Channels of a picture that are compared together.
#[derive(Debug, Clone)]
pub struct Layer {
    /// Empty for the picture itself.
    pub name: String,
    /// What its numbers are.
    pub meaning: Meaning,
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Where the top left pixel lies in the frame.
    pub origin: [i32; 2],
    /// Names of the channels, without the layer's.
    pub channels: Vec<String>,
    /// All channels of a pixel together, rows from the top.
    pub values: Vec<f32>,
    /// Stored in 16 bits.
    pub half: bool,
}

impl Layer {
    /// The name for people.
    pub fn shown(&self) -> &str {
        if self.name.is_empty() { "beauty" } else { &self.name }
    }

    /// Whether its light is one channel, that of R, G and B alike.
    pub fn is_grey(&self) -> bool {
        self.meaning == Meaning::Light && self.channels.len() == 1
    }
}

/// `Limit` for more bytes than [`MAX_BYTES`].
pub fn fits(path: &Path, bytes: u64) -> Result<()> {
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    let message = format!("found {bytes} bytes of pixels, the limit is {MAX_BYTES}");
    Err(Error::new(Kind::Limit, Problem::new(path.display().to_string(), message)))
}
