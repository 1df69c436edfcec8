//! Description of a part of a picture: all that a merge needs in addition to its pixels.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::error::{Error, Result};
use crate::film::Window;
use crate::layers::{PartialSumsLayout, PixelLayout};
use crate::output::exr::Compression;
use crate::output::legend::Legend;
use crate::output::tonemap::Depth;
use crate::scene::Tonemap;

/// Name of the EXR attribute that holds the description as JSON.
pub const ATTRIBUTE: &str = "lightpath:part";

/// A part of a picture: some of its pixels, some of its samples, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartDescription {
    /// SHA-256 of the scene and its files; `None` if a mesh is read from a pipe.
    pub fingerprint: Option<String>,
    /// Instruction set of Embree: the last bits of its results may depend on it. `None` for
    /// backends that give the same bits on every instruction set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isa: Option<String>,
    /// Window of the merged picture: x0, y0, x1, y1, the last two exclusive.
    pub whole: [u32; 4],
    /// `[I, N]` of `--tile I/N`.
    pub tile: Option<[u32; 2]>,
    /// Index of the first sample, and one past the last.
    pub samples: [u32; 2],
    /// Number of samples per pixel of the merged picture.
    pub of: u32,
    /// True if the file holds full precision, false if it is rounded to 16-bit floats.
    pub exact: bool,
    /// Format of the merged picture's files.
    pub files: PictureFormat,
    /// Layers of the merged picture.
    #[serde(rename = "recipe")]
    pub layout: PixelLayout,
}

/// Format of a picture's files.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureFormat {
    /// Store 32-bit floats instead of 16-bit floats.
    pub float: bool,
    /// Compression method of the EXR.
    pub compression: Compression,
    /// Write one part of the EXR per layer.
    pub multipart: bool,
    /// Bits per channel of the PNG.
    pub depth: Depth,
    /// Write an alpha channel to the PNG.
    pub transparent: bool,
    /// Tone curve of the PNG: `max`, `clamp` or `reinhard`.
    pub tonemap: String,
    /// Exposure of the PNG in stops.
    pub exposure: f32,
    /// Use the sRGB transfer function in the PNG.
    pub srgb: bool,
    /// Legend of the PNG.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub legend: Option<Legend>,
    /// The PNG of the part shows a plate, which a merge does not have. Parts may differ in it:
    /// their EXRs have no plate.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub over: bool,
}

impl PictureFormat {
    /// Returns the default format with the given tone mapping.
    pub fn new(tonemap: &Tonemap) -> Self {
        Self {
            tonemap: json!(tonemap.operator).as_str().unwrap_or_default().to_string(),
            exposure: tonemap.exposure,
            srgb: tonemap.srgb,
            ..Self::default()
        }
    }

    /// Returns the tone mapping of the PNG, or `None` if the name of its operator is unknown.
    pub fn curve(&self) -> Option<Tonemap> {
        let operator = serde_json::from_value(self.tonemap.as_str().into()).ok()?;
        Some(Tonemap { operator, exposure: self.exposure, srgb: self.srgb })
    }
}

impl PartDescription {
    /// Returns the description as JSON: the value of [`ATTRIBUTE`].
    ///
    /// # Errors
    /// A failure to serialise, which cannot occur with the present types.
    pub fn text(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|error| Error::invalid(ATTRIBUTE, error.to_string()))
    }

    /// Returns the description of the merged picture as a part of its frame; `None` if it is the
    /// whole frame.
    pub fn merged(&self, frame: [u32; 2]) -> Option<Self> {
        let all = Window::full(frame[0], frame[1]);
        let PictureFormat { float, compression, .. } = self.files;
        let merged = Self {
            whole: [all.x0, all.y0, all.x1, all.y1],
            tile: None,
            samples: [0, self.of],
            exact: float && !compression.is_lossy(),
            ..self.clone()
        };
        (self.whole() != all).then_some(merged)
    }

    /// Returns the range of samples.
    pub fn samples(&self) -> Range<u32> {
        self.samples[0]..self.samples[1]
    }

    /// Returns the layout of the sums, or `None` if the part has all samples.
    pub fn raw(&self) -> Option<PartialSumsLayout> {
        let samples = self.samples();
        (samples != (0..self.of)).then(|| PartialSumsLayout::new(&self.layout, samples))
    }

    /// Returns the window of the merged picture.
    pub fn whole(&self) -> Window {
        let [x0, y0, x1, y1] = self.whole;
        Window { x0, y0, x1, y1 }
    }

    /// Returns what is wrong with the description, or `None`. `frame` and `window` are the display
    /// and the data window of its file.
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
        if !self.layout.is_sound() {
            return Some("its layers are not among its channels");
        }
        if self.files.curve().is_none() {
            return Some("the tone curve is unknown");
        }
        None
    }
}

/// Returns tile `i` (from 1) of `n`: a band of rows. `n` must be at most the height. If the tiles
/// have at least 32 rows on average, all but the last have a multiple of 16 rows.
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
