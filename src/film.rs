//! The picture in memory: linear radiance per pixel, before any file format.

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
        Self {
            x0: 0,
            y0: 0,
            x1: width,
            y1: height,
        }
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

/// Linear BT.709 radiance, premultiplied alpha, row-major over the data window.
#[derive(Debug, Clone)]
pub struct Film {
    /// Width and height of the full frame (the display window).
    pub frame: [u32; 2],
    /// What was rendered (the data window).
    pub window: Window,
    /// `window.width() * window.height()` pixels of R, G, B, A.
    pub pixels: Vec<[f32; 4]>,
}

impl Film {
    /// A black, transparent film.
    pub fn new(frame: [u32; 2], window: Window) -> Self {
        let pixels = vec![[0.0; 4]; window.width() as usize * window.height() as usize];
        Self {
            frame,
            window,
            pixels,
        }
    }
}
