//! How far a pixel's mean still is from its value, and which pixels get more samples.
//!
//! The samples of a pixel are taken in passes that double their number, so both halves of them are
//! stratified sets. Were the halves independent, the squared difference of their means would be four times
//! the variance of the mean over all of them; as they are halves of one Sobol set, which avoid each other,
//! it is more. So the error is never underestimated in the mean, and it falls as fast as that of stratified
//! samples does, where the variance of single samples says nothing of their order. The two halves are the
//! image pair of Dammertz et al. 2010, "A Hierarchical Automatic Stopping Condition for Monte Carlo Global
//! Illumination", the measure relates them to is the relative squared error of Rousselle et al. 2011,
//! "Adaptive Sampling and Reconstruction using Greedy Error Minimization".

/// Weights along a side of the window over which errors are averaged.
const WINDOW: [f64; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];

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
    /// How many it shall have since the last choice.
    pub aim: u32,
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
}

impl Goal {
    /// The squared level that a pixel's error is relative to, summed over R, G, B.
    fn level(&self, radiance: [f64; 3]) -> f64 {
        let floor = match self.relative {
            Relative::Pixel => (DARK * self.mean).powi(2),
            Relative::Picture => return 3.0 * self.mean.powi(2),
        };
        radiance.iter().map(|radiance| radiance * radiance + floor).sum()
    }

    /// Squared error of a good pixel with so many samples. Where variances fall as a power of the number of samples,
    /// the sum of all pixels' is least for a sum of samples if variance / samples is the same in each (by a Lagrange
    /// multiplier).
    fn limit(&self, samples: u32) -> f64 {
        let limit = self.noise * self.noise;
        match self.relative {
            Relative::Pixel => limit,
            Relative::Picture => limit * f64::from(samples) / NOMINAL_SAMPLES,
        }
    }
}

impl Tally {
    /// Squared relative standard error of the mean: of R, G, B together, relative to what the goal says; of alpha
    /// relative to 1. Whichever is more; 0 where a sample is not finite, as more of them would not help.
    pub fn error(&self, goal: &Goal) -> f64 {
        let n = f64::from(self.taken.max(1));
        // (first half - second half) / 2, as means.
        let apart: [f64; 4] = std::array::from_fn(|c| (self.sum[c] - 2.0 * self.half[c]) / n);
        let [r, g, b, alpha] = apart.map(|apart| apart * apart);
        let level = goal.level([0, 1, 2].map(|c| self.sum[c] / n));
        let error = ((r + g + b) / level).max(alpha);
        if error.is_finite() { error } else { 0.0 }
    }
}

/// Gives the pixels that are not yet good twice their samples; whether there are any. `tallies` are those
/// of a rectangle `width` pixels wide.
///
/// A pixel is good if its own error is, and that of its neighbourhood: one alone may look good because
/// its few samples all missed what its neighbours met.
pub fn choose(tallies: &mut [Tally], width: usize, goal: &Goal) -> bool {
    let errors: Vec<f64> = tallies.iter().map(|tally| tally.error(goal)).collect();
    let mut any = false;
    for (i, tally) in tallies.iter_mut().enumerate() {
        let around = around(&errors, width, i);
        let more = errors[i].max(around) > goal.limit(tally.taken) && tally.taken < goal.most;
        tally.aim = if more { 2 * tally.taken } else { tally.taken };
        tally.wanted = tally.aim;
        any |= more;
    }
    any
}

/// The weighted mean of the errors around a pixel, within the rectangle.
fn around(errors: &[f64], width: usize, at: usize) -> f64 {
    let (x, y, height) = (at % width, at / width, errors.len() / width);
    let reach = WINDOW.len() / 2;
    let (mut sum, mut weights) = (0.0, 0.0);
    for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
        for column in x.saturating_sub(reach)..(x + reach + 1).min(width) {
            let weight = WINDOW[row + reach - y] * WINDOW[column + reach - x];
            sum += weight * errors[row * width + column];
            weights += weight;
        }
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(first: f64, second: f64) -> Tally {
        let sum = [first + second; 4];
        Tally { sum, half: [second; 4], taken: 16, wanted: 16, aim: 16 }
    }

    const GOAL: Goal = Goal { noise: 0.1, relative: Relative::Pixel, mean: 0.0, most: 64 };

    #[test]
    fn the_error_is_half_of_what_the_halves_differ_by() {
        // Means of the halves 1 and 2, of all 1.5.
        let one = tally(8.0, 16.0);
        let relative = (0.5f64 / 1.5).powi(2);
        assert!((one.error(&GOAL) - relative.max(0.25)).abs() < 1e-12);
        let mut opaque = one;
        (opaque.sum[3], opaque.half[3]) = (16.0, 8.0);
        assert!((opaque.error(&GOAL) - relative).abs() < 1e-12);
        // The floor adds to the level.
        let floored = 0.25 / (2.25 + 4.0);
        assert!((opaque.error(&Goal { mean: 20.0, ..GOAL }) - floored).abs() < 1e-12);
        // Of the picture only its mean counts.
        let picture = Goal { relative: Relative::Picture, mean: 20.0, ..GOAL };
        assert!((opaque.error(&picture) - 0.25 / 400.0).abs() < 1e-12);
        for goal in [GOAL, Goal { mean: 0.0, ..picture }] {
            assert_eq!(tally(0.0, 0.0).error(&goal), 0.0);
            assert_eq!(tally(f64::NAN, 1.0).error(&goal), 0.0);
            assert_eq!(tally(f64::INFINITY, 1.0).error(&goal), 0.0);
        }
    }

    #[test]
    fn neighbours_of_a_noisy_pixel_go_on_and_distant_ones_stop() {
        let mut tallies = [tally(8.0, 8.0); 144];
        tallies[12 * 5 + 5] = tally(0.0, 16.0);
        assert!(choose(&mut tallies, 12, &GOAL));
        let chosen = |x: usize, y: usize| tallies[12 * y + x].aim == 32;
        assert!(chosen(5, 5) && chosen(6, 5) && chosen(4, 4) && chosen(7, 5));
        assert!(!chosen(8, 5) && !chosen(5, 2) && !chosen(0, 0) && !chosen(11, 11));
        assert_eq!((tallies[65].wanted, tallies[0].wanted), (32, 16));
    }

    #[test]
    fn of_the_picture_more_samples_may_err_more() {
        let goal = Goal { relative: Relative::Picture, mean: 1.0, ..GOAL };
        // Means of the halves 1 and 1.3: the error is 0.15, the limit 0.1 times the root of samples / 16.
        for (taken, more) in [(16, true), (32, true), (64, false)] {
            let n = f64::from(taken) / 2.0;
            let one = Tally { taken, ..tally(n, 1.3 * n) };
            assert_eq!(choose(&mut [one], 1, &Goal { most: 1024, ..goal }), more, "{taken}");
        }
    }

    #[test]
    fn no_pixel_gets_more_than_the_most() {
        let mut tallies = [Tally { taken: 64, wanted: 64, ..tally(0.0, 64.0) }; 4];
        assert!(!choose(&mut tallies, 2, &GOAL));
        assert_eq!(tallies[0].wanted, 64);
    }

    #[test]
    fn the_weights_at_a_border_are_those_within() {
        let errors = [1.0; 6];
        for at in 0..6 {
            assert!((around(&errors, 3, at) - 1.0).abs() < 1e-12);
        }
    }
}
