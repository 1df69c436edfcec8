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

/// When a pixel has samples enough.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// Relative standard error.
    pub noise: f64,
    /// Radiance below which errors count as if the pixel had it.
    pub floor: f64,
    /// Samples that no pixel exceeds.
    pub most: u32,
}

impl Tally {
    /// Squared relative standard error of the mean: of R, G, B together, each pixel's own level or the
    /// floor being 1; of alpha relative to 1. Whichever is more; 0 where a sample is not finite, as more of
    /// them would not help.
    pub fn error(&self, floor: f64) -> f64 {
        let n = f64::from(self.taken.max(1));
        // (first half - second half) / 2, as means.
        let apart: [f64; 4] = std::array::from_fn(|c| (self.sum[c] - 2.0 * self.half[c]) / n);
        let mut squares = [0.0; 2];
        for c in 0..3 {
            squares[0] += apart[c] * apart[c];
            squares[1] += (self.sum[c] / n).powi(2) + floor * floor;
        }
        let error = (squares[0] / squares[1]).max(apart[3] * apart[3]);
        if error.is_finite() { error } else { 0.0 }
    }
}

/// Gives the pixels that are not yet good twice their samples; whether there are any. `tallies` are those
/// of a rectangle `width` pixels wide.
///
/// A pixel is good if its own error is, and that of its neighbourhood: one alone may look good because
/// its few samples all missed what its neighbours met.
pub fn choose(tallies: &mut [Tally], width: usize, goal: &Goal) -> bool {
    let errors: Vec<f64> = tallies.iter().map(|tally| tally.error(goal.floor)).collect();
    let limit = goal.noise * goal.noise;
    let mut any = false;
    for (i, tally) in tallies.iter_mut().enumerate() {
        let around = around(&errors, width, i);
        let more = errors[i].max(around) > limit && tally.taken < goal.most;
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

    const GOAL: Goal = Goal { noise: 0.1, floor: 0.0, most: 64 };

    #[test]
    fn the_error_is_half_of_what_the_halves_differ_by() {
        // Means of the halves 1 and 2, of all 1.5.
        let one = tally(8.0, 16.0);
        let relative = (0.5f64 / 1.5).powi(2);
        assert!((one.error(0.0) - relative.max(0.25)).abs() < 1e-12);
        let mut opaque = one;
        (opaque.sum[3], opaque.half[3]) = (16.0, 8.0);
        assert!((opaque.error(0.0) - relative).abs() < 1e-12);
        // The floor adds to the level.
        let floored = 0.25 / (2.25 + 4.0);
        assert!((opaque.error(2.0) - floored).abs() < 1e-12);
        assert_eq!(tally(0.0, 0.0).error(0.0), 0.0);
        assert_eq!(tally(f64::NAN, 1.0).error(0.0), 0.0);
        assert_eq!(tally(f64::INFINITY, 1.0).error(0.0), 0.0);
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
