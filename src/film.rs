//! The picture in memory: linear radiance per pixel, before any file format.

use std::io;
use std::ops::{Deref, DerefMut};

use memmap2::{Advice, MmapMut};

use crate::error::{Error, Kind, Problem, Result};

/// A rectangle of pixels, top-left origin; `x1`, `y1` are excluded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Left.
    pub x0: u32,
    /// Top.
    pub y0: u32,
    /// Right, excluded.
    pub x1: u32,
    /// Bottom, excluded.
    pub y1: u32,
}

impl Window {
    /// The whole frame.
    pub fn full(width: u32, height: u32) -> Self {
        Self { x0: 0, y0: 0, x1: width, y1: height }
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }
}

/// R, G, B, A of many pixels, zero at first.
///
/// Fresh pages of their own, with the advice to use huge ones.
#[derive(Debug)]
pub struct Pixels(MmapMut);

impl Pixels {
    fn new(count: usize) -> io::Result<Self> {
        let bytes = count.checked_mul(size_of::<[f32; 4]>()).ok_or(io::ErrorKind::OutOfMemory)?;
        // A map of no bytes is an error, a film of no pixels is not.
        let map = MmapMut::map_anon(bytes.max(size_of::<[f32; 4]>()))?;
        // Advice only: a kernel without huge pages is no error.
        let _ = map.advise(Advice::HugePage);
        Ok(Self(map))
    }
}

impl Deref for Pixels {
    type Target = [[f32; 4]];
    fn deref(&self) -> &Self::Target {
        bytemuck::cast_slice(&self.0)
    }
}

impl DerefMut for Pixels {
    fn deref_mut(&mut self) -> &mut Self::Target {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// Linear BT.709 radiance, premultiplied alpha, row-major over the data window.
#[derive(Debug)]
pub struct Film {
    /// Width and height of the full frame (the display window).
    pub frame: [u32; 2],
    /// What was rendered (the data window).
    pub window: Window,
    /// `window.width() * window.height()` pixels of R, G, B, A.
    pub pixels: Pixels,
}

impl Film {
    /// A black, transparent film whose memory is there: a machine without it says so now, not
    /// in the middle of a render.
    ///
    /// # Errors
    /// `Retry` if there is no memory for it.
    pub fn new(frame: [u32; 2], window: Window) -> Result<Self> {
        let count = window.width() as usize * window.height() as usize;
        let mut pixels = Pixels::new(count).map_err(|error| {
            let message = format!("no memory for {count} pixels: {error}");
            Error::new(Kind::Retry, Problem::new("film", message))
        })?;
        pixels.fill([0.0; 4]);
        Ok(Self { frame, window, pixels })
    }
}
