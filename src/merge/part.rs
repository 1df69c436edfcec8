//! What a part says about itself: everything that a merge needs to know beside its pixels.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::film::Window;
use crate::layers::{Raw, Recipe};
use crate::output::{exr::Compression, tonemap::Depth};
use crate::scene::{ToneOperator, Tonemap};

/// The attribute of an EXR that holds it, as JSON.
pub const ATTRIBUTE: &str = "lightpath:part";

/// A piece of a picture: some of its pixels, or some of its samples, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// SHA-256 of what the picture is made of; none where a mesh came through a pipe.
    pub fingerprint: Option<String>,
    /// Embree's instruction set, whose last bits may be its own. None of a backend that computes the same
    /// bits in all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isa: Option<String>,
    /// The pixels that all parts have together: x0, y0, x1, y1, the last two excluded.
    pub whole: [u32; 4],
    /// `[I, N]` of `--tile I/N`.
    pub tile: Option<[u32; 2]>,
    /// First sample, and the one after the last.
    pub samples: [u32; 2],
    /// Samples of the whole picture.
    pub of: u32,
    /// Whether the file holds what the render had, and not that rounded to halves.
    pub exact: bool,
    /// How the whole picture's files are written.
    pub files: Files,
    /// Its layers.
    pub recipe: Recipe,
}

/// How a picture becomes files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Files {
    /// 32-bit floats in place of halves.
    pub float: bool,
    /// Of the EXR.
    pub compression: Compression,
    /// A part of the EXR for every layer.
    pub multipart: bool,
    /// Bits of the PNG's channels.
    pub depth: Depth,
    /// The PNG has an alpha channel.
    pub transparent: bool,
    /// `max`, `clamp` or `reinhard`.
    pub tonemap: String,
    /// Stops.
    pub exposure: f32,
    /// sRGB transfer in the PNG.
    pub srgb: bool,
}

impl Files {
    /// Of a tone curve; the rest as it is by default.
    pub fn new(tonemap: &Tonemap) -> Self {
        let operator = match tonemap.operator {
            ToneOperator::Max => "max",
            ToneOperator::Clamp => "clamp",
            ToneOperator::Reinhard => "reinhard",
        };
        Self {
            float: false,
            compression: Compression::default(),
            multipart: false,
            depth: Depth::default(),
            transparent: false,
            tonemap: operator.to_string(),
            exposure: tonemap.exposure,
            srgb: tonemap.srgb,
        }
    }

    /// The tone curve, or none if its name is unknown.
    pub fn curve(&self) -> Option<Tonemap> {
        let operator = match self.tonemap.as_str() {
            "max" => ToneOperator::Max,
            "clamp" => ToneOperator::Clamp,
            "reinhard" => ToneOperator::Reinhard,
            _ => return None,
        };
        Some(Tonemap { operator, exposure: self.exposure, srgb: self.srgb })
    }
}

impl Part {
    /// Its samples.
    pub fn samples(&self) -> Range<u32> {
        self.samples[0]..self.samples[1]
    }

    /// The words of its pixels, if it holds sums over some of the samples.
    pub fn raw(&self) -> Option<Raw> {
        let samples = self.samples();
        (samples != (0..self.of)).then(|| Raw::new(&self.recipe, samples))
    }

    /// The pixels that all parts have together.
    pub fn whole(&self) -> Window {
        let [x0, y0, x1, y1] = self.whole;
        Window { x0, y0, x1, y1 }
    }

    /// What is wrong with it, given the frame of its file and the pixels in it.
    pub fn problem(&self, frame: [u32; 2], window: Window) -> Option<&'static str> {
        let (whole, [first, end]) = (self.whole(), self.samples);
        let within = |inner: Window, outer: Window| {
            inner.x0 >= outer.x0
                && inner.y0 >= outer.y0
                && inner.x1 <= outer.x1
                && inner.y1 <= outer.y1
        };
        if whole.x0 >= whole.x1 || whole.y0 >= whole.y1 {
            return Some("the whole picture is empty");
        }
        if !within(whole, Window::full(frame[0], frame[1])) || !within(window, whole) {
            return Some("its pixels are not within the whole picture");
        }
        if first >= end || end > self.of {
            return Some("its samples are not within those of the whole picture");
        }
        if self.tile.is_some_and(|[i, n]| i < 1 || i > n || n > whole.height()) {
            return Some("there is no such tile");
        }
        if !self.recipe.is_sound() {
            return Some("its layers are not among its channels");
        }
        if self.files.curve().is_none() {
            return Some("the tone curve is unknown");
        }
        None
    }
}

/// Rows of tile `i` (from 1) of `n`: bands of whole rows, along multiples of 16 rows where there are enough.
pub fn band(window: Window, i: u32, n: u32) -> Window {
    let height = u64::from(window.height());
    let unit = if height / u64::from(n) >= 32 { 16 } else { 1 };
    let cut = |i: u32| match i {
        0 => window.y0,
        i if i == n => window.y1,
        i => window.y0 + (height * u64::from(i) / u64::from(n) / unit * unit) as u32,
    };
    Window { y0: cut(i - 1), y1: cut(i), ..window }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_a_window_once() {
        for (y0, y1) in [(0, 7), (3, 1000), (0, 32), (5, 2165)] {
            let window = Window { x0: 2, y0, x1: 9, y1 };
            for n in (1..=40).filter(|n| *n <= window.height()) {
                let bands: Vec<_> = (1..=n).map(|i| band(window, i, n)).collect();
                assert_eq!((bands[0].y0, bands[n as usize - 1].y1), (y0, y1));
                assert!(bands.windows(2).all(|two| two[0].y1 == two[1].y0));
                assert!(bands.iter().all(|band| band.y0 < band.y1), "{window:?} {n}");
            }
        }
    }
}
