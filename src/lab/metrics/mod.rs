//! Metrics of the difference between a picture and a reference, each with one name and a formula.
//!
//! x is a value of the picture, r a value of the reference, and d = x - r. Means run over all
//! pixels and channels. Names of metrics are ambiguous: the relative errors of pbrt and tev differ
//! by a factor of 100 where the reference is black. So no number is shown without its formula.
//!
//! The errors of pictures with NaN or infinities are undefined. Callers check with [`non_finite`]
//! first.

mod errors;
pub mod flip;
mod plane;
mod ssim;

pub use errors::ValueErrors;
pub use ssim::ssim;

use crate::lab::named::named;
use crate::output::srgb;

named! {
    /// A measure of how far a picture is from a reference.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Metric {
        /// Mean squared error over all values.
        Mse = "mse",
        /// Root of the mean squared error.
        Rmse = "rmse",
        /// Mean absolute error over all values.
        Mae = "mae",
        /// Relative squared error with epsilon outside the square (relMSE).
        Relmse = "relmse",
        /// Relative squared error with epsilon inside the square (MRSE).
        Mrse = "mrse",
        /// Symmetric mean absolute error (SMAPE).
        Smape = "smape",
        /// Mean signed difference; > 0 if the picture is brighter than the reference on average.
        Bias = "bias",
        /// Largest absolute difference of a value.
        Max = "max",
        /// 99th percentile of the absolute differences.
        P99 = "p99",
        /// Share of values that are not equal.
        Differ = "differ",
        /// Peak signal-to-noise ratio of the 8-bit pictures.
        Psnr = "psnr",
        /// Structural similarity of the 8-bit pictures.
        Ssim = "ssim",
        /// LDR-FLIP of the 8-bit pictures.
        Flip = "flip",
        /// HDR-FLIP of linear light, over several exposures.
        HdrFlip = "hdrflip",
    }
}

impl Metric {
    /// Formula of the metric, with x, r and d as in the module's documentation.
    pub fn formula(self) -> &'static str {
        match self {
            Self::Mse => "mean d^2",
            Self::Rmse => "sqrt(mean d^2)",
            Self::Mae => "mean |d|",
            Self::Relmse => "mean d^2 / (r^2 + 0.01)",
            Self::Mrse => "mean d^2 / (|r| + 0.01)^2",
            Self::Smape => "mean |d| / (|x| + |r| + 0.01)",
            Self::Bias => "mean d",
            Self::Max => "max |d|",
            Self::P99 => "the least |d| that 99% of all |d| do not exceed",
            Self::Differ => "fraction of values with d != 0",
            Self::Psnr => "10 log10(1 / mean d^2) dB of the 8-bit pictures in [0, 1]",
            Self::Ssim => {
                "11x11 Gaussian, sigma 1.5, K 0.01 0.03, BT.709 luma of the 8-bit pictures"
            }
            Self::Flip => "mean LDR-FLIP of the 8-bit pictures, 67 pixels per degree",
            Self::HdrFlip => {
                "mean of the largest LDR-FLIP over exposures, ACES, 67 pixels per degree"
            }
        }
    }

    /// Returns whether larger values are better.
    pub fn more_is_better(self) -> bool {
        matches!(self, Self::Psnr | Self::Ssim)
    }

    /// Finds the metric with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|metric| metric.name() == name)
    }
}

/// Metrics with their values. Metrics that have no meaning for the layer are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MetricValues(Vec<(Metric, f64)>);

impl MetricValues {
    /// Value of a metric, if it is there.
    pub fn get(&self, metric: Metric) -> Option<f64> {
        self.0.iter().find(|(other, _)| *other == metric).map(|(_, value)| *value)
    }

    /// All metrics with values, in the order of [`Metric::ALL`]. PSNR is infinite for equal
    /// pictures.
    pub fn iter(&self) -> impl Iterator<Item = (Metric, f64)> {
        self.0.iter().copied()
    }

    /// Appends metrics with their values.
    pub fn extend(&mut self, values: impl IntoIterator<Item = (Metric, f64)>) {
        self.0.extend(values);
    }

    /// Lets [`Metric::Differ`], a share of `pixels`, also count `more` pixels, which all differ.
    pub fn count_different(&mut self, pixels: usize, more: u64) {
        let (pixels, more) = (pixels as f64, more as f64);
        for (_, value) in self.0.iter_mut().filter(|(metric, _)| *metric == Metric::Differ) {
            *value = (*value * pixels + more) / (pixels + more).max(1.0);
        }
    }

    /// Compares ids: the share of values whose bits differ.
    pub fn of_ids(test: &[f32], reference: &[f32]) -> Self {
        let pairs = test.iter().zip(reference);
        let differ = pairs.filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        Self(vec![(Metric::Differ, differ as f64 / test.len().max(1) as f64)])
    }

    /// Errors of data such as depths and normals, without the relative errors of light.
    pub fn of_data(test: &[f32], reference: &[f32]) -> Self {
        let mut errors = Self::of_light(test, reference);
        errors.0.retain(|(m, _)| !matches!(m, Metric::Relmse | Metric::Mrse | Metric::Smape));
        errors
    }

    /// Errors of linear light.
    pub fn of_light(test: &[f32], reference: &[f32]) -> Self {
        let e = ValueErrors::of(test, reference);
        Self(vec![
            (Metric::Mse, e.mse),
            (Metric::Rmse, e.mse.sqrt()),
            (Metric::Mae, e.mae),
            (Metric::Relmse, e.relmse),
            (Metric::Mrse, e.mrse),
            (Metric::Smape, e.smape),
            (Metric::Bias, e.bias),
            (Metric::Max, e.max),
            (Metric::P99, e.p99),
            (Metric::Differ, e.differ),
        ])
    }

    /// Errors of 8-bit sRGB pictures, and LDR-FLIP of each pixel.
    pub fn of_pictures(test: &[[u8; 3]], reference: &[[u8; 3]], width: usize) -> (Self, Vec<f64>) {
        let bytes = test.as_flattened().iter().zip(reference.as_flattened());
        let squares = bytes.map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum::<u64>();
        let mse = squares as f64 / (255.0 * 255.0 * (3 * test.len()).max(1) as f64);
        let mut values = vec![(Metric::Psnr, -10.0 * mse.log10())];
        values.extend(ssim(test, reference, width).map(|value| (Metric::Ssim, value)));
        let linear = |pixels: &[[u8; 3]]| -> Vec<[f32; 3]> {
            pixels
                .iter()
                .map(|p| p.map(|byte| srgb::to_linear(f64::from(byte) / 255.0) as f32))
                .collect()
        };
        let map = flip::ldr(&linear(test), &linear(reference), width);
        values.push((Metric::Flip, mean(&map)));
        (Self(values), map)
    }
}

/// The mean of `values`; 0 if there are none.
pub fn mean(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { super::stats::mean(values) }
}

/// Returns the number of pixels with a NaN or an infinity, and the index of the first. A pixel has
/// `channels` values.
pub fn non_finite(values: &[f32], channels: usize) -> (u64, Option<usize>) {
    let pixels = values.chunks(channels.max(1)).enumerate();
    let mut bad = pixels.filter(|(_, p)| p.iter().any(|v| !v.is_finite())).map(|(i, _)| i);
    let first = bad.next();
    (bad.count() as u64 + u64::from(first.is_some()), first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_and_unique() {
        for metric in Metric::ALL {
            assert_eq!(Metric::named(metric.name()), Some(metric));
        }
        assert_eq!(Metric::named("relMSE"), None);
    }

    #[test]
    fn psnr_in_closed_form() {
        // One byte of 12 is off by 51 = 0.2.
        let (mut a, b) = ([[0; 3]; 4], [[0; 3]; 4]);
        a[2][1] = 51;
        let (values, map) = MetricValues::of_pictures(&a, &b, 2);
        let expected = 10.0 * (12.0f64 / 0.04).log10();
        assert!((values.get(Metric::Psnr).unwrap() - expected).abs() < 1e-12);
        assert_eq!((values.get(Metric::Ssim), map.len()), (None, 4));
        let (same, _) = MetricValues::of_pictures(&b, &b, 2);
        assert_eq!(same.get(Metric::Psnr), Some(f64::INFINITY));
        assert_eq!(same.get(Metric::Flip), Some(0.0));
    }

    #[test]
    fn values_that_are_not_finite_are_found() {
        let values = [0.0, 1.0, f32::NAN, 0.0, 2.0, f32::INFINITY];
        assert_eq!(non_finite(&values, 2), (2, Some(1)));
        assert_eq!(non_finite(&values, 3), (2, Some(0)));
        assert_eq!(non_finite(&values[..2], 2), (0, None));
    }

    #[test]
    fn ids_are_compared_as_bits() {
        let nan = f32::NAN;
        assert_eq!(MetricValues::of_ids(&[nan, 1.0], &[nan, 2.0]).get(Metric::Differ), Some(0.5));
    }
}
