//! The picture in memory: linear radiance per pixel and the layers beside it, before any file format.

mod dropped;
mod planes;
mod sums;

pub use self::dropped::Dropped;
pub use self::planes::{Channel, ChannelKind, Planes};
pub use self::sums::{Node, Sums};

use rayon::prelude::*;

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

/// Linear BT.709 radiance, premultiplied alpha, row-major over the data window.
#[derive(Debug)]
pub struct Film {
    /// Width and height of the full frame (the display window).
    pub frame: [u32; 2],
    /// Pixels of overscan on every side of the frame: where its top left is in the window's coordinates.
    pub margin: u32,
    /// What was rendered (the data window).
    pub window: Window,
    /// `window.width() * window.height()` pixels of R, G, B, A.
    pub pixels: Vec<[f32; 4]>,
    /// The layers that were asked for; mostly none.
    pub planes: Planes,
    /// What the layers of mattes could not hold.
    pub dropped: Dropped,
}

impl Film {
    /// Left and top of the data window, seen from the frame's top left.
    pub fn origin(&self) -> [i32; 2] {
        [self.window.x0, self.window.y0].map(|side| side.wrapping_sub(self.margin) as i32)
    }

    /// A black, transparent film whose memory is there: a machine without it says so now, not
    /// in the middle of a render.
    ///
    /// # Errors
    /// `Retry` if there is no memory for it.
    pub fn new(frame: [u32; 2], window: Window) -> Result<Self> {
        Ok(Blank::new(frame, window, Vec::new())?.film())
    }
}

/// Addresses for a film, without memory behind them yet: what the accelerator needs only while it
/// is built need not stand beside the picture.
#[derive(Debug)]
pub struct Blank {
    frame: [u32; 2],
    window: Window,
    pixels: Vec<[f32; 4]>,
    planes: Planes,
}

impl Blank {
    /// Sets the addresses aside for R, G, B, A and `channels` beside them.
    ///
    /// # Errors
    /// `Retry` if the system refuses so much.
    pub fn new(frame: [u32; 2], window: Window, channels: Vec<Channel>) -> Result<Self> {
        let count = window.width() as usize * window.height() as usize;
        let words = count.saturating_mul(channels.len());
        let mut pixels = Vec::new();
        let mut planes = Planes { channels, words: Vec::new() };
        let reserved = pixels.try_reserve_exact(count);
        reserved.and_then(|()| planes.words.try_reserve_exact(words)).map_err(|_| {
            let bytes = count.saturating_mul(size_of::<[f32; 4]>());
            let bytes = bytes.saturating_add(words.saturating_mul(size_of::<u32>()));
            let message = format!("no memory for {count} pixels of together {bytes} bytes");
            Error::new(Kind::Retry, Problem::new("film", message))
        })?;
        Ok(Self { frame, window, pixels, planes })
    }

    /// The film, all of its memory touched, on the threads of the caller's rayon pool: no page faults are left to
    /// the render.
    pub fn film(self) -> Film {
        let Self { frame, window, mut pixels, mut planes } = self;
        let count = window.width() as usize * window.height() as usize;
        touch(&mut pixels, count, [0.0; 4]);
        let words = count * planes.channels.len();
        touch(&mut planes.words, words, 0);
        Film { frame, margin: 0, window, pixels, planes, dropped: Dropped::default() }
    }
}

/// Elements that are worth a task of their own.
const GRAIN: usize = 1 << 16;

/// Makes an array of room for them `count` times `value`. Where pages are given one by one that takes as long as to
/// trace a ray for every pixel.
fn touch<T: Copy + Send + Sync>(array: &mut Vec<T>, count: usize, value: T) {
    (0..count).into_par_iter().with_min_len(GRAIN).map(|_| value).collect_into_vec(array);
}
