//! The picture in memory: linear radiance per pixel and its layers, independent of any file format.

mod dropped;
mod planes;
mod sums;

pub use self::dropped::Dropped;
pub use self::planes::{Channel, ChannelKind, Planes};
pub use self::sums::{SampleSums, SumNode};

use rayon::prelude::*;

use crate::error::{Error, Result};

/// A rectangle of pixels. x counts columns from the left and y rows from the top of the frame with
/// its overscan. `x1` and `y1` are exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Left edge (first column).
    pub x0: u32,
    /// Top edge (first row).
    pub y0: u32,
    /// Right edge (first column outside).
    pub x1: u32,
    /// Bottom edge (first row outside).
    pub y1: u32,
}

impl Window {
    /// Returns the window of a whole frame.
    pub fn full(width: u32, height: u32) -> Self {
        Self { x0: 0, y0: 0, x1: width, y1: height }
    }

    /// Width of the window in pixels.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Height of the window in pixels.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }

    /// Number of pixels in the window.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width()) * u64::from(self.height())
    }
}

/// A picture in linear BT.709 radiance with premultiplied alpha, row by row over the data window.
#[derive(Debug, Clone)]
pub struct Film {
    /// Width and height of the full frame (the display window).
    pub frame: [u32; 2],
    /// Width in pixels of the overscan on each side of the frame. In the coordinates of `window`,
    /// the frame's top left is at (`overscan`, `overscan`).
    pub overscan: u32,
    /// The rendered window (the data window).
    pub window: Window,
    /// R, G, B, A of `window.width() * window.height()` pixels.
    pub pixels: Vec<[f32; 4]>,
    /// The requested layers; empty for most renders.
    pub planes: Planes,
    /// Coverage that the matte layers could not hold.
    #[doc(hidden)]
    pub dropped: Dropped,
}

impl Film {
    /// Left and top of the data window, relative to the frame's top left.
    pub fn origin(&self) -> [i32; 2] {
        [self.window.x0, self.window.y0].map(|side| side.wrapping_sub(self.overscan) as i32)
    }

    /// Returns the part of the data window that is in the frame, counted from the data window's top
    /// left; all of it if none is.
    pub fn in_frame(&self) -> Window {
        let Window { x0, y0, x1, y1 } = self.window;
        let [x, y] = [(x0, x1, self.frame[0]), (y0, y1, self.frame[1])].map(|(from, to, side)| {
            let edge = |at: u32| at.clamp(from, to) - from;
            [edge(self.overscan), edge(self.overscan.saturating_add(side))]
        });
        match x[0] < x[1] && y[0] < y[1] {
            true => Window { x0: x[0], y0: y[0], x1: x[1], y1: y[1] },
            false => Window::full(self.window.width(), self.window.height()),
        }
    }

    /// Makes a black, transparent film without layers. Its memory is allocated and touched, so a
    /// lack of memory shows now, not in the middle of a render.
    ///
    /// # Errors
    /// `Invalid` for a window that is empty or not within the frame; `Retry` if memory is lacking.
    pub fn new(frame: [u32; 2], window: Window) -> Result<Self> {
        Self::check_window(frame, window)?;
        Ok(ReservedFilm::new(frame, window, Vec::new())?.film())
    }

    /// Checks that the arrays, which a caller may have set, have the window's pixels.
    ///
    /// # Errors
    /// `Invalid` for another number of values, or for a window that is empty or not within the
    /// frame and its overscan.
    pub(crate) fn check(&self) -> Result<()> {
        let end = self.frame.map(|side| side.saturating_add(self.overscan.saturating_mul(2)));
        Self::check_window(end, self.window)?;
        let pixels = self.window.pixels();
        let words = pixels.saturating_mul(self.planes.channels.len() as u64);
        for (name, found, expected) in [
            ("pixels", self.pixels.len(), pixels),
            ("planes.words", self.planes.words.len(), words),
        ] {
            if found as u64 != expected {
                let message = format!("found {found} values in `{name}`, expected {expected}");
                return Err(Error::invalid("film", message));
            }
        }
        Ok(())
    }

    fn check_window([width, height]: [u32; 2], window: Window) -> Result<()> {
        let Window { x0, y0, x1, y1 } = window;
        if x0 < x1 && x1 <= width && y0 < y1 && y1 <= height {
            return Ok(());
        }
        let found = format!("found the window x {x0}..{x1}, y {y0}..{y1}");
        let message = format!("{found}, expected pixels of a frame of {width} x {height}");
        Err(Error::invalid("film", message))
    }
}

/// A film whose addresses are reserved, but whose memory is not touched yet. So the picture takes
/// no memory while the accelerator is built.
#[derive(Debug)]
pub struct ReservedFilm {
    frame: [u32; 2],
    window: Window,
    pixels: Vec<[f32; 4]>,
    planes: Planes,
}

impl ReservedFilm {
    /// Reserves addresses for R, G, B, A and the layers' `channels`.
    ///
    /// # Errors
    /// `Retry` if the system refuses to reserve that much.
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
            Error::no_memory("film", message)
        })?;
        Ok(Self { frame, window, pixels, planes })
    }

    /// Makes the film. Fills all its memory with zeros, on the threads of the current rayon pool,
    /// so that the render has no page faults.
    pub fn film(self) -> Film {
        let Self { frame, window, mut pixels, mut planes } = self;
        let count = window.width() as usize * window.height() as usize;
        touch(&mut pixels, count, [0.0; 4]);
        let words = count * planes.channels.len();
        touch(&mut planes.words, words, 0);
        Film { frame, overscan: 0, window, pixels, planes, dropped: Dropped::default() }
    }
}

/// Minimum number of elements of a rayon task.
const GRAIN: usize = 1 << 16;

/// Fills a reserved array with `count` times `value`, in parallel. Where the system maps pages one
/// by one, this takes as long as tracing a ray for every pixel.
fn touch<T: Copy + Send + Sync>(array: &mut Vec<T>, count: usize, value: T) {
    (0..count).into_par_iter().with_min_len(GRAIN).map(|_| value).collect_into_vec(array);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_outside_of_the_frame_is_refused() {
        let window = |x0, y0, x1, y1| Film::new([8, 6], Window { x0, y0, x1, y1 });
        assert!(window(0, 0, 8, 6).is_ok() && window(7, 5, 8, 6).is_ok());
        for bad in [window(5, 0, 2, 6), window(0, 0, 9, 6), window(0, 6, 8, 6), window(3, 0, 3, 6)]
        {
            assert_eq!(bad.unwrap_err().kind, crate::error::ErrorKind::Invalid);
        }
    }

    #[test]
    fn the_part_in_the_frame_lies_in_the_data_window() {
        let in_frame = |overscan, window| {
            let film = Film::new([4, 3], Window::full(4, 3)).unwrap();
            Film { overscan, window, ..film }.in_frame()
        };
        let window = |x0, y0, x1, y1| Window { x0, y0, x1, y1 };
        assert_eq!(in_frame(0, Window::full(4, 3)), Window::full(4, 3));
        assert_eq!(in_frame(0, window(1, 1, 3, 2)), Window::full(2, 1), "a crop");
        assert_eq!(in_frame(2, Window::full(8, 7)), window(2, 2, 6, 5));
        assert_eq!(in_frame(2, window(3, 0, 8, 4)), window(0, 2, 3, 4), "a part of it");
        assert_eq!(in_frame(2, window(0, 0, 2, 7)), Window::full(2, 7), "none of it");
    }

    #[test]
    fn a_film_with_fewer_values_than_pixels_is_refused() {
        let film = || Film::new([4, 3], Window::full(4, 3)).unwrap();
        assert!(film().check().is_ok());
        let around = Window::full(6, 5);
        assert!(
            Film { overscan: 1, window: around, pixels: vec![[0.0; 4]; 30], ..film() }
                .check()
                .is_ok()
        );
        let refused = |film: Film| film.check().unwrap_err().to_string();
        let short = refused(Film { pixels: vec![[0.0; 4]; 11], ..film() });
        assert!(short.contains("found 11 values in `pixels`, expected 12"), "{short}");
        let words = Planes { words: vec![1], ..Planes::default() };
        let words = refused(Film { planes: words, ..film() });
        assert!(words.contains("`planes.words`, expected 0"), "{words}");
    }
}
