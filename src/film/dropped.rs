//! Matte coverage that is lost because more things (shapes or materials) cover a pixel than its
//! mattes have ranks.

/// Coverage that no rank holds, of one or more pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Dropped {
    /// Number of pixels that are covered by more things than there are ranks.
    pub pixels: u64,
    /// Largest lost share of one pixel, in [0, 1].
    pub share: f32,
    /// Largest number of things that cover one pixel.
    pub things: u32,
}

impl Dropped {
    /// Combines the losses of different pixels.
    pub fn and(self, other: Self) -> Self {
        Self { pixels: self.pixels + other.pixels, ..self.or(other) }
    }

    /// Combines the losses of the same pixel in different mattes.
    pub fn or(self, other: Self) -> Self {
        Self {
            pixels: self.pixels.max(other.pixels),
            share: self.share.max(other.share),
            things: self.things.max(other.things),
        }
    }
}
