//! A layer of both files, and what the comparison found on it.

use super::half::HalfRounding;
use super::layer::PictureLayer;
use super::misses::Misses;
use crate::lab::metrics::MetricValues;

/// Pixels with a NaN or an infinity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NonFinite {
    /// Number of such pixels in the picture and in the reference.
    pub pixels: [u64; 2],
    /// Position in the frame of the first such pixel of either.
    pub first: [i64; 2],
}

/// One layer of both files with its metrics.
#[derive(Debug)]
pub struct Compared {
    /// Layer of the picture.
    pub test: PictureLayer,
    /// Layer of the reference.
    pub reference: PictureLayer,
    /// Metrics of the layer, without pixels that miss; `differ` counts those that miss in one file
    /// alone. Empty if a pixel is not finite.
    pub values: MetricValues,
    /// Pixels that are not finite, if any.
    pub non_finite: Option<NonFinite>,
    /// Pixels of a layer of depths that miss, if any.
    pub misses: Option<Misses>,
    /// Whether picture and reference are stored as half floats.
    pub half: [bool; 2],
    /// Expected errors if only rounding to half floats caused them. `None` for ids, for values that
    /// are not finite, and if no file stores half floats.
    pub floor: Option<HalfRounding>,
    /// Picture and reference as tone mapped 8-bit pixels, for light.
    pub pictures: Option<[Vec<[u8; 3]>; 2]>,
    /// FLIP of each pixel, for light: HDR-FLIP of two EXRs, else LDR-FLIP.
    pub flip: Option<Vec<f64>>,
}
