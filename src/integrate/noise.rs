//! How far a pixel's mean still is from its value.
//!
//! The samples of a pixel are taken in passes that double their number, so both halves of them are
//! stratified sets. Were the halves independent, the squared difference of their means would be four times
//! the variance of the mean over all of them; as they are halves of one Sobol set, which avoid each other,
//! it is more. So the error is never underestimated in the mean, and it falls as fast as that of stratified
//! samples does, where the variance of single samples says nothing of their order. The two halves are the
//! image pair of Dammertz et al. 2010, "A Hierarchical Automatic Stopping Condition for Monte Carlo Global
//! Illumination", the measure relates them to is the relative squared error of Rousselle et al. 2011,
//! "Adaptive Sampling and Reconstruction using Greedy Error Minimization".

use crate::sampler::Kind;

/// The samples that one pixel has.
#[derive(Debug, Clone, Copy, Default)]
pub struct Tally {
    /// R, G, B, A summed over all of them.
    pub sum: [f64; 4],
    /// The same over their second half.
    pub half: [f64; 4],
    /// How many there are.
    pub taken: u32,
    /// How many there will be after the next pass.
    pub wanted: u32,
    /// How many there are after the present doubling, which one pass takes or several.
    pub aim: u32,
    /// How many there will be after all doublings that are decided.
    pub plan: u32,
}

/// What a pixel's error is relative to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Relative {
    /// Its own radiance, and a floor: every pixel becomes as good.
    #[default]
    Pixel,
    /// The frame's mean radiance, and how many samples the pixel has: the frame's squared error becomes as small as
    /// its number of samples allows.
    Picture,
}

/// The level that stands for the picture's dark parts, relative to its mean radiance: the root of the 0.01
/// in `relmse`, for a picture of mean 1.
const DARK: f64 = 0.1;

/// Relative to the picture, [`Goal::noise`] is the error of a good pixel with so many samples.
const NOMINAL_SAMPLES: f64 = 16.0;

/// Largest error that is told from larger ones, relative to the target squared: more than calls for all samples
/// that a pixel may have.
pub const LARGEST: f32 = (1u32 << 28) as f32;

/// When a pixel has samples enough.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// Relative standard error of a good pixel; relative to the picture, of one with 16 samples.
    pub noise: f64,
    /// What that is relative to.
    pub relative: Relative,
    /// Mean radiance of the frame, over R, G, B.
    pub mean: f64,
    /// Samples that no pixel exceeds.
    pub most: u32,
    /// What the variance of a pixel's mean is expected to be multiplied by when its samples double.
    fall: f64,
    /// The same of its error relative to what may be left.
    gain: f64,
}

/// The power by which the variance of a pixel's mean is expected to fall with its samples: of stratified points that
/// of the slopes in docs/notebook/sampling.md.
pub fn rate(kind: Kind) -> f64 {
    match kind {
        Kind::Sobol => 1.75,
        Kind::Random => 1.0,
    }
}

impl Goal {
    /// A goal of pixels whose variance falls as samples^-rate: see [`rate`].
    pub fn new(noise: f64, relative: Relative, mean: f64, most: u32, rate: f64) -> Self {
        let fall = (-rate).exp2();
        let gain = match relative {
            Relative::Pixel => fall,
            Relative::Picture => fall / 2.0,
        };
        Self { noise, relative, mean, most, fall, gain }
    }

    /// What an error after `from` samples is expected to be multiplied by when there are `to`, a power of two more
    /// or fewer.
    pub fn fall(&self, from: u32, to: u32) -> f32 {
        let doublings = to.ilog2() as i32 - from.ilog2() as i32;
        self.fall.powi(doublings) as f32
    }

    /// The squared level that a pixel's error is relative to, summed over R, G, B.
    fn level(&self, radiance: [f64; 3]) -> f64 {
        let floor = match self.relative {
            Relative::Pixel => (DARK * self.mean).powi(2),
            Relative::Picture => return 3.0 * self.mean.powi(2),
        };
        radiance.iter().map(|radiance| radiance * radiance + floor).sum()
    }

    /// How many samples a pixel needs, of which `error` is expected after `taken`: `taken` times the power of two that
    /// is nearest to what its variance has to fall by, up to `most`.
    ///
    /// Relative to the picture a pixel's error may grow with its samples: where variances fall as a power of the
    /// number of samples, the sum of all pixels' is least for a sum of samples if variance / samples is the same in
    /// each (by a Lagrange multiplier).
    pub fn samples(&self, taken: u32, error: f64) -> u32 {
        let limit = match self.relative {
            Relative::Pixel => 1.0,
            Relative::Picture => f64::from(taken) / NOMINAL_SAMPLES,
        };
        // Half of a doubling off: the nearest power.
        let (mut samples, mut error) = (taken, error * self.gain.sqrt());
        while error > limit && samples < self.most {
            (samples, error) = (2 * samples, error * self.gain);
        }
        samples
    }
}

impl Tally {
    /// Squared standard error of the mean over the goal's squared target, up to 2^28: of R, G, B together, relative to
    /// what the goal says; of alpha relative to 1. Whichever is more; 0 where a sample is not finite, as more of them
    /// would not help.
    pub fn error(&self, goal: &Goal) -> f32 {
        let n = f64::from(self.taken.max(1));
        // (first half - second half) / 2, as means.
        let apart: [f64; 4] = std::array::from_fn(|c| (self.sum[c] - 2.0 * self.half[c]) / n);
        let [r, g, b, alpha] = apart.map(|apart| apart * apart);
        let level = goal.level([0, 1, 2].map(|c| self.sum[c] / n));
        let error = ((r + g + b) / level).max(alpha);
        let error = if error.is_finite() { error / goal.noise.powi(2) } else { 0.0 };
        (error as f32).min(LARGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(first: f64, second: f64) -> Tally {
        let sum = [first + second; 4];
        Tally { sum, half: [second; 4], taken: 16, wanted: 16, aim: 16, plan: 16 }
    }

    fn goal(relative: Relative, mean: f64) -> Goal {
        Goal::new(0.125, relative, mean, 64, 1.0)
    }

    #[test]
    fn the_error_is_half_of_what_the_halves_differ_by() {
        let close = |tally: Tally, goal: &Goal, error: f64| {
            let found = f64::from(tally.error(goal)) * goal.noise.powi(2);
            assert!((found - error).abs() < 1e-7, "{found} {error}");
        };
        let plain = goal(Relative::Pixel, 0.0);
        // Means of the halves 1 and 2, of all 1.5.
        let one = tally(8.0, 16.0);
        let relative = (0.5f64 / 1.5).powi(2);
        close(one, &plain, relative.max(0.25));
        let mut opaque = one;
        (opaque.sum[3], opaque.half[3]) = (16.0, 8.0);
        close(opaque, &plain, relative);
        // The floor adds to the level.
        close(opaque, &goal(Relative::Pixel, 20.0), 0.25 / (2.25 + 4.0));
        // Of the picture only its mean counts.
        let picture = goal(Relative::Picture, 20.0);
        close(opaque, &picture, 0.25 / 400.0);
        for goal in [plain, goal(Relative::Picture, 0.0)] {
            for bad in [tally(0.0, 0.0), tally(f64::NAN, 1.0), tally(f64::INFINITY, 1.0)] {
                assert_eq!(bad.error(&goal), 0.0);
            }
        }
        let tiny = Goal { noise: 1e-300, ..plain };
        assert_eq!(one.error(&tiny), LARGEST);
    }

    #[test]
    fn samples_are_the_nearest_power_of_two_that_is_expected_to_do() {
        let plain = goal(Relative::Pixel, 0.0);
        for (error, expected) in [(0.0, 16), (1.4, 16), (1.5, 32), (2.8, 32), (2.9, 64), (9e9, 64)]
        {
            assert_eq!(plain.samples(16, error), expected, "{error}");
        }
        assert_eq!([plain.fall(16, 64), plain.fall(32, 16)], [0.25, 2.0]);
        // Stratified samples need fewer, and of the picture more samples may err more.
        let stratified = |relative| Goal::new(0.1, relative, 0.0, 1024, 2.0);
        assert_eq!(stratified(Relative::Pixel).samples(16, 64.0), 128);
        let picture = stratified(Relative::Picture);
        assert_eq!(
            [(16, 64.0), (64, 4.0), (64, 64.0)].map(|(n, e)| picture.samples(n, e)),
            [64, 64, 128]
        );
    }
}
