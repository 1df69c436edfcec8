//! Coverage of mattes that was not stored, because a pixel saw more things than it has ranks.

/// Coverage that no rank holds, of a pixel or of many.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Dropped {
    /// Pixels that saw more things than they have ranks.
    pub pixels: u64,
    /// The largest share of one pixel that was dropped, in [0, 1].
    pub share: f32,
    /// The most things that one pixel saw.
    pub things: u32,
}

impl Dropped {
    /// Both, where they are of other pixels.
    pub fn and(self, other: Self) -> Self {
        Self { pixels: self.pixels + other.pixels, ..self.or(other) }
    }

    /// Both, where they are of the same pixels.
    pub fn or(self, other: Self) -> Self {
        Self {
            pixels: self.pixels.max(other.pixels),
            share: self.share.max(other.share),
            things: self.things.max(other.things),
        }
    }
}
