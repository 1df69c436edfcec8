//! The layer channels of a film, beside R, G, B, A.

use serde::{Deserialize, Serialize};

/// Storage type of a channel in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// 16-bit float: colours, normals, cosines, fractions.
    Half,
    /// 32-bit float: depths, positions, texture coordinates, variances, sample counts, mattes.
    Float,
    /// 32-bit unsigned integer: ids.
    Uint,
}

/// Name and storage type of a channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// Full name: `LAYER.CHANNEL`, or a channel without a layer.
    pub name: String,
    /// Storage type in the file.
    pub kind: ChannelKind,
}

/// The layer channels of all pixels. In memory, each channel of a pixel is a word of 32 bits.
#[derive(Debug, Clone, Default)]
pub struct Planes {
    /// Names and types of the channels, in the order of a pixel's words.
    pub channels: Vec<Channel>,
    /// One word per channel, pixel by pixel, row by row: the bits of an f32, or a u32.
    pub words: Vec<u32>,
}

impl Planes {
    /// Returns the index of the channel with this name.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|channel| channel.name == name)
    }

    /// Returns the value of a `Half` or `Float` channel. `pixel` is the index in the window, row by
    /// row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn float(&self, channel: usize, pixel: usize) -> f32 {
        f32::from_bits(self.words[pixel * self.channels.len() + channel])
    }

    /// Returns the value of a `Uint` channel. `pixel` is the index in the window, row by row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn uint(&self, channel: usize, pixel: usize) -> u32 {
        self.words[pixel * self.channels.len() + channel]
    }
}
