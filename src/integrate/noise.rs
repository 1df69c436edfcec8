//! Error estimate of a pixel's mean, and the number of samples it needs.
//!
//! The samples of a pixel are taken in passes that double their number, so both halves of the
//! samples are stratified sets. If the halves were independent, the squared difference of their
//! means would be four times the variance of the mean over all samples. They are halves of one
//! Sobol set, which mostly avoid each other, so the difference is mostly larger. Then the mean of
//! the estimate is not below the error. The estimate also falls as fast as the error of stratified
//! samples does. The variance of single samples does not depend on their order, so it cannot show
//! that.
//!
//! The two halves are the image pair of Dammertz et al. 2010, "A Hierarchical Automatic Stopping
//! Condition for Monte Carlo Global Illumination". The measure is the relative squared error of
//! Rousselle et al. 2011, "Adaptive Sampling and Reconstruction using Greedy Error Minimization".

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sampler::SamplerKind;

/// Sums and numbers of samples of one pixel.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelSamples {
    /// Sum of R, G, B, A over all samples.
    pub sum: [f64; 4],
    /// Sum of R, G, B, A over the second half of the samples. Valid if the last pass took a whole
    /// doubling.
    pub half: [f64; 4],
    /// Number of samples taken.
    pub taken: u32,
    /// Number of samples after the next pass.
    pub wanted: u32,
    /// Number of samples after the current doubling, which takes one pass or several.
    pub aim: u32,
    /// Number of samples after all doublings that are decided.
    pub plan: u32,
}

/// What the error of a pixel is relative to.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Relative {
    /// Each pixel's own radiance and a floor: all pixels get the same relative error.
    #[default]
    Pixel,
    /// The frame's mean radiance, with a larger error where a pixel has more samples: the lowest
    /// RMSE for the samples taken.
    Picture,
}

/// Level of the picture's dark parts, relative to its mean radiance: the root of the 0.01 in
/// `relmse`, for a picture of mean 1.
const DARK: f64 = 0.1;

/// Number of samples for which [`Goal::noise`] is the allowed error of a pixel, with
/// [`Relative::Picture`].
const NOMINAL_SAMPLES: f64 = 16.0;

/// Upper limit of errors, as squared error over squared target. An error this large needs all
/// samples that a pixel may have.
pub const MAX_ERROR: f32 = (1u32 << 28) as f32;

/// The error that a pixel may have, and how its variance falls.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// Allowed relative standard error of a pixel; with [`Relative::Picture`], of a pixel with 16
    /// samples.
    pub noise: f64,
    /// What the error is relative to.
    pub relative: Relative,
    /// Mean radiance of the frame, over R, G, B.
    pub mean: f64,
    /// Largest number of samples of a pixel; a power of two.
    pub most: u32,
    /// Expected factor of the variance of a pixel's mean when its samples double.
    fall: f64,
    /// Expected factor of the ratio of a pixel's error to its limit when its samples double.
    gain: f64,
}

/// Exponent r of the expected variance of a pixel's mean, samples^-r. For stratified points, from
/// the slopes in docs/notebook/sampling.md. Lights that are drawn leave little to stratify.
pub fn rate(kind: SamplerKind, draws_lights: bool) -> f64 {
    match kind {
        SamplerKind::Sobol if !draws_lights => 1.75,
        _ => 1.0,
    }
}

impl Goal {
    /// A goal for pixels whose variance falls as samples^-rate: see [`rate`].
    pub fn new(noise: f64, relative: Relative, mean: f64, most: u32, rate: f64) -> Self {
        let fall = (-rate).exp2();
        let gain = match relative {
            Relative::Pixel => fall,
            Relative::Picture => fall / 2.0,
        };
        Self { noise, relative, mean, most, fall, gain }
    }

    /// Expected factor of an error between `from` samples and `to` samples. Their ratio must be a
    /// power of two; `to` may be the smaller one.
    pub fn fall(&self, from: u32, to: u32) -> f32 {
        let doublings = to.ilog2() as i32 - from.ilog2() as i32;
        self.fall.powi(doublings) as f32
    }

    /// Squared level that a pixel's error is relative to, summed over R, G, B.
    fn level(&self, radiance: [f64; 3]) -> f64 {
        let floor = match self.relative {
            Relative::Pixel => (DARK * self.mean).powi(2),
            Relative::Picture => return 3.0 * self.mean.powi(2),
        };
        radiance.iter().map(|radiance| radiance * radiance + floor).sum()
    }

    /// Number of samples that a pixel needs whose expected error after `taken` samples is `error`.
    /// The result is `taken` times the power of two that is nearest to the factor at which the
    /// error falls to its limit, up to [`Goal::most`]. `taken` must be a power of two.
    ///
    /// With [`Relative::Picture`] the allowed error grows with the samples of a pixel. Where
    /// variances fall as a power of the number of samples, a Lagrange multiplier gives the optimum.
    /// For a fixed sum of samples, the sum of all variances is least if variance / samples is the
    /// same in each pixel.
    pub fn samples(&self, taken: u32, error: f64) -> u32 {
        let limit = match self.relative {
            Relative::Pixel => 1.0,
            Relative::Picture => f64::from(taken) / NOMINAL_SAMPLES,
        };
        // The root of one doubling's factor rounds to the nearest power of two.
        let (mut samples, mut error) = (taken, error * self.gain.sqrt());
        while error > limit && samples < self.most {
            (samples, error) = (2 * samples, error * self.gain);
        }
        samples
    }
}

impl PixelSamples {
    /// Squared standard error of the mean over the goal's squared target, at most 2^28. The larger
    /// of two errors: R, G, B together, relative to the goal's level, and alpha, relative to 1.
    /// A colour that is not finite adds no error, because more samples would not help. Its alpha
    /// counts. A difference relative to a level of 0 is as large as can be.
    pub fn error(&self, goal: &Goal) -> f32 {
        let n = f64::from(self.taken.max(1));
        // (first half - second half) / 2, as means.
        let apart: [f64; 4] = std::array::from_fn(|c| (self.sum[c] - 2.0 * self.half[c]) / n);
        let [r, g, b, alpha] = apart.map(|apart| apart * apart);
        let level = goal.level([0, 1, 2].map(|c| self.sum[c] / n));
        let finite = |error: f64| if error.is_finite() { error } else { 0.0 };
        let color = finite(r + g + b);
        let relative = if color > 0.0 { color / level } else { 0.0 };
        let error = relative.max(finite(alpha));
        // The square of the noise may underflow to 0.
        let share = if error > 0.0 { error / goal.noise.powi(2) } else { 0.0 };
        (share as f32).min(MAX_ERROR)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(first: f64, second: f64) -> PixelSamples {
        let sum = [first + second; 4];
        PixelSamples { sum, half: [second; 4], taken: 16, wanted: 16, aim: 16, plan: 16 }
    }

    fn goal(relative: Relative, mean: f64) -> Goal {
        Goal::new(0.125, relative, mean, 64, 1.0)
    }

    #[test]
    fn the_error_is_half_the_difference_of_the_halves() {
        let close = |tally: PixelSamples, goal: &Goal, error: f64| {
            let found = f64::from(tally.error(goal)) * goal.noise.powi(2);
            assert!((found - error).abs() < 1e-7, "{found} {error}");
        };
        let plain = goal(Relative::Pixel, 0.0);
        // The means of the halves are 1 and 2; the mean of all samples is 1.5.
        let one = tally(8.0, 16.0);
        let relative = (0.5f64 / 1.5).powi(2);
        close(one, &plain, relative.max(0.25));
        let mut opaque = one;
        (opaque.sum[3], opaque.half[3]) = (16.0, 8.0);
        close(opaque, &plain, relative);
        // The floor adds to the level.
        close(opaque, &goal(Relative::Pixel, 20.0), 0.25 / (2.25 + 4.0));
        // Relative to the picture, only its mean counts.
        let picture = goal(Relative::Picture, 20.0);
        close(opaque, &picture, 0.25 / 400.0);
        for goal in [plain, goal(Relative::Picture, 0.0)] {
            for bad in [tally(0.0, 0.0), tally(f64::NAN, 1.0), tally(f64::INFINITY, 1.0)] {
                assert_eq!(bad.error(&goal), 0.0);
            }
        }
        // Alpha counts beside a colour that is not finite.
        for goal in [plain, picture] {
            for bad in [f64::NAN, f64::INFINITY] {
                let mut infinite = one;
                (infinite.sum[0], infinite.half[1]) = (bad, bad);
                close(infinite, &goal, 0.25);
            }
        }
        let dark = goal(Relative::Picture, 0.0);
        assert_eq!(one.error(&dark), MAX_ERROR, "no probe has met light");
        let tiny = Goal { noise: 1e-300, ..plain };
        assert_eq!(one.error(&tiny), MAX_ERROR);
        assert_eq!(tally(0.0, 0.0).error(&tiny), 0.0, "nothing to refine");
    }

    #[test]
    fn samples_are_rounded_to_the_nearest_power_of_two() {
        let plain = goal(Relative::Pixel, 0.0);
        for (error, expected) in [(0.0, 16), (1.4, 16), (1.5, 32), (2.8, 32), (2.9, 64), (9e9, 64)]
        {
            assert_eq!(plain.samples(16, error), expected, "{error}");
        }
        assert_eq!([plain.fall(16, 64), plain.fall(32, 16)], [0.25, 2.0]);
        // Stratified samples need fewer. Relative to the picture, pixels with more samples may have
        // a larger error.
        let stratified = |relative| Goal::new(0.1, relative, 0.0, 1024, 2.0);
        assert_eq!(stratified(Relative::Pixel).samples(16, 64.0), 128);
        let picture = stratified(Relative::Picture);
        assert_eq!(
            [(16, 64.0), (64, 4.0), (64, 64.0)].map(|(n, e)| picture.samples(n, e)),
            [64, 64, 128]
        );
    }
}
