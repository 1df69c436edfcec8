//! What stands in a film beside R, G, B, A: channels of layers.

use serde::{Deserialize, Serialize};

/// How a channel is stored in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// 16-bit float: colours and normals.
    Half,
    /// 32-bit float: depth, positions, mattes.
    Float,
    /// 32-bit unsigned integer: numbers of things.
    Uint,
}

/// A channel by its name in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// `LAYER.CHANNEL`, or a channel without a layer.
    pub name: String,
    /// How it is stored.
    pub kind: ChannelKind,
}

/// Channels beside the beauty. In memory every one has 32 bits.
#[derive(Debug, Default)]
pub struct Planes {
    /// The channels of each pixel.
    pub channels: Vec<Channel>,
    /// Pixel by pixel, one word a channel: the bits of an f32, or a u32.
    pub words: Vec<u32>,
}

impl Planes {
    /// Index of the channel of that name.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|channel| channel.name == name)
    }

    /// A channel of a pixel (its number in the window, row by row) as a float.
    pub fn float(&self, channel: usize, pixel: usize) -> f32 {
        f32::from_bits(self.words[pixel * self.channels.len() + channel])
    }

    /// A channel of a pixel as an unsigned integer.
    pub fn uint(&self, channel: usize, pixel: usize) -> u32 {
        self.words[pixel * self.channels.len() + channel]
    }
}
