//! Decides how many samples each pixel gets, without the pixel's own samples.
//!
//! A mean is biased if the number of its samples depends on these samples. So the number of a
//! pixel's samples is a function of the samples of other pixels, whose sequences are independent of
//! its own. The mean over the pixel's first n samples then has the right expectation for each n:
//!
//! - First plan: from the errors of the neighbours after the first pass. That pass has the same
//!   size for all pixels.
//! - Second plan: from the errors of the neighbours after the samples that the first plan would
//!   give them without this pixel. How far a neighbour is sampled beyond that depends on this
//!   pixel, so those samples are not used.
//!
//! Without one pixel, the first plans of its neighbours are lower or the same: weights are fixed
//! and no error is negative. So the samples that the second plan reads have been taken. The sums of
//! the first plan are integers, so that subtracting a pixel leaves no rounding error.

use super::noise::{Goal, MAX_ERROR};

/// Binomial weights of the windows over which errors are averaged, from the middle outwards: 5 x 5
/// and 9 x 9 pixels. The small window is sharper; the large one also sees features that few samples
/// hit.
const WINDOWS: [&[u64]; 2] = [&[6, 4, 1], &[70, 56, 28, 8, 1]];

/// Radius of the larger window in pixels.
const REACH: usize = 4;

/// Integer steps per unit of error, for exact sums.
const STEPS: f32 = 65536.0;

/// The errors of the pixels of a rectangle.
#[derive(Debug)]
pub struct Errors {
    width: usize,
    /// Samples per pixel of the first pass.
    first: u32,
    /// Error by pixel, after `first`, 2 `first`, 4 `first` ... samples:
    /// [`super::noise::PixelSamples::error`].
    levels: Vec<Vec<f32>>,
}

/// Result of the first plan.
#[derive(Debug)]
pub struct SamplePlan {
    /// Number of samples, by pixel.
    pub samples: Vec<u32>,
    /// Sums over the neighbours of each pixel.
    sums: Vec<NeighbourSums>,
}

/// Weighted sums over the neighbours of a pixel, by window.
type NeighbourSums = [WeightedSum; WINDOWS.len()];

/// A weighted sum over the neighbours of a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct WeightedSum {
    errors: u64,
    weights: u64,
}

impl WeightedSum {
    fn mean(self) -> f64 {
        self.errors as f64 / (self.weights.max(1) as f64 * f64::from(STEPS))
    }
}

fn steps(error: f32) -> u64 {
    (error.min(MAX_ERROR) * STEPS) as u64
}

/// Weight in each window of a pixel at this distance, across and down.
fn weights(apart: [usize; 2]) -> [u64; WINDOWS.len()] {
    WINDOWS.map(|weights| {
        let [x, y] = apart.map(|apart| weights.get(apart).copied().unwrap_or(0));
        x * y
    })
}

impl Errors {
    /// Creates the errors of a rectangle `width` pixels wide, without values.
    pub fn new(width: usize, first: u32) -> Self {
        Self { width, first, levels: Vec::new() }
    }

    /// Sets the error of pixel `at` of `count` pixels after `samples`, which is `first` times a
    /// power of two.
    pub fn set(&mut self, at: usize, count: usize, samples: u32, error: f32) {
        let level = self.level(samples);
        while self.levels.len() <= level {
            self.levels.push(vec![0.0; count]);
        }
        self.levels[level][at] = error;
    }

    /// Computes the first plan: numbers of samples from the errors after the first pass.
    pub fn first_plan(&self, goal: &Goal) -> SamplePlan {
        let errors: Vec<u64> = self.levels[0].iter().map(|&error| steps(error)).collect();
        let mut sums = vec![NeighbourSums::default(); errors.len()];
        for (window, weights) in WINDOWS.into_iter().enumerate() {
            // Sums by row, then by column, without the pixel itself.
            let (width, height) = (self.width, errors.len() / self.width);
            let across =
                |at: usize| line(at % width, width, weights, |x| errors[at - at % width + x]);
            let rows: Vec<WeightedSum> = (0..errors.len()).map(across).collect();
            let own = weights[0] * weights[0];
            for (at, sums) in sums.iter_mut().enumerate() {
                let down =
                    line(at / width, height, weights, |y| rows[y * width + at % width].errors);
                sums[window] = WeightedSum {
                    errors: down.errors - own * errors[at],
                    weights: down.weights * rows[at].weights - own,
                };
            }
        }
        let samples = sums.iter().map(|sums| self.by(goal, self.first, sums)).collect();
        SamplePlan { samples, sums }
    }

    /// Computes the second plan: numbers of samples from the errors after the samples of the first
    /// plan.
    pub fn second_plan(&self, goal: &Goal, first: &SamplePlan) -> Vec<u32> {
        (0..first.samples.len()).map(|at| self.second(goal, first, at)).collect()
    }

    /// Second plan of pixel `at`.
    fn second(&self, goal: &Goal, first: &SamplePlan, at: usize) -> u32 {
        let (width, height) = (self.width, first.samples.len() / self.width);
        let (x, y, taken) = (at % width, at / width, first.samples[at]);
        let (left, right) = (x.saturating_sub(REACH), (x + REACH + 1).min(width));
        let rows = || (y.saturating_sub(REACH)..(y + REACH + 1).min(height)).map(|row| row * width);
        let even = |row: usize| first.samples[row + left..row + right].iter().all(|&n| n == taken);
        if taken == self.first && rows().all(even) {
            // All errors are the ones of the first plan, so the sums are the same.
            return taken;
        }
        let mut sums =
            first.sums[at].map(|WeightedSum { weights, .. }| WeightedSum { errors: 0, weights });
        for row in rows() {
            for other in (row + left..row + right).filter(|&other| other != at) {
                let apart = [(other - row).abs_diff(x), (row / width).abs_diff(y)];
                let weights = weights(apart);
                let samples = self.without(goal, first, (other, at), weights);
                // Expected error after as many samples as this pixel has.
                let error = self.levels[self.level(samples)][other] * goal.fall(samples, taken);
                for (sum, weight) in sums.iter_mut().zip(weights) {
                    sum.errors += weight * steps(error);
                }
            }
        }
        self.by(goal, taken, &sums)
    }

    /// First plan of pixel `at` if pixel `out` had no error. `weights` are the weights of `out`
    /// there.
    fn without(
        &self,
        goal: &Goal,
        plan: &SamplePlan,
        (at, out): (usize, usize),
        weights: [u64; WINDOWS.len()],
    ) -> u32 {
        let error = steps(self.levels[0][out]);
        if plan.samples[at] == self.first || error == 0 {
            return plan.samples[at];
        }
        let mut sums = plan.sums[at];
        for (sum, weight) in sums.iter_mut().zip(weights) {
            sum.errors -= weight * error;
        }
        self.by(goal, self.first, &sums)
    }

    /// Number of samples of a pixel, from its neighbours' errors after `taken` samples.
    fn by(&self, goal: &Goal, taken: u32, sums: &NeighbourSums) -> u32 {
        let need = sums.iter().map(|sum| sum.mean()).fold(0.0, f64::max);
        goal.samples(taken, need)
    }

    fn level(&self, samples: u32) -> usize {
        (samples / self.first).ilog2() as usize
    }
}

/// Weighted sum of the values around place `at` of a line, `at` included.
fn line(at: usize, length: usize, weights: &[u64], value: impl Fn(usize) -> u64) -> WeightedSum {
    let mut sum = WeightedSum::default();
    for place in (at + 1).saturating_sub(weights.len())..(at + weights.len()).min(length) {
        let weight = weights[place.abs_diff(at)];
        sum.errors += weight * value(place);
        sum.weights += weight;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::noise::Relative;
    use super::*;

    fn goal(relative: Relative) -> Goal {
        Goal::new(0.1, relative, 0.0, 1024, 1.5)
    }

    /// Both plans for pixels whose errors after 16, 32 ... samples are `error`.
    fn plans(
        goal: &Goal,
        width: usize,
        count: usize,
        error: impl Fn(usize, u32) -> f32,
    ) -> [Vec<u32>; 2] {
        let mut errors = Errors::new(width, 16);
        (0..count).for_each(|at| errors.set(at, count, 16, error(at, 16)));
        let first = errors.first_plan(goal);
        for at in 0..count {
            let mut samples = 32;
            while samples <= first.samples[at] {
                errors.set(at, count, samples, error(at, samples));
                samples *= 2;
            }
        }
        let second = errors.second_plan(goal, &first);
        [first.samples, second]
    }

    #[test]
    fn only_the_neighbours_of_a_noisy_pixel_get_more_samples() {
        let noisy = 12 * 5 + 5;
        let [_, second] =
            plans(&goal(Relative::Pixel), 12, 144, |at, _| if at == noisy { 1e4 } else { 0.0 });
        let more = |x: usize, y: usize| second[12 * y + x] > 16;
        assert!(more(6, 5) && more(4, 4) && more(7, 5) && more(9, 5));
        assert!(!more(5, 5) && !more(10, 5) && !more(0, 0) && !more(11, 11));
    }

    #[test]
    fn the_second_plan_follows_how_fast_errors_fall() {
        let even = |fall: f32| {
            let error = move |_, samples: u32| 64.0 * (16.0 / samples as f32).powf(fall);
            plans(&goal(Relative::Pixel), 8, 64, error)
        };
        let [first, slow] = even(1.0);
        assert!(first.iter().all(|&samples| samples == 256), "{first:?}");
        assert!(slow.iter().all(|&samples| samples > 256), "{slow:?}");
        let [first, as_expected] = even(1.5);
        assert_eq!(first, as_expected);
    }

    #[test]
    fn a_pixels_number_does_not_depend_on_its_own_samples() {
        let hash = |x: u64| {
            let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            x ^ (x >> 31)
        };
        for case in 0..400u64 {
            let (width, count) = (7, 7 * 6);
            let relative = if case % 2 == 0 { Relative::Pixel } else { Relative::Picture };
            let goal = goal(relative);
            // Heavy tails: most errors are 0 or small, some are the largest possible.
            let error = |seed: u64, at: usize, samples: u32| {
                let bits = hash(hash(case * 1000 + seed) ^ (at as u64) << 32 ^ u64::from(samples));
                let scale = ((bits % 64) as f32 - 36.0).exp2().min(268_435_456.0);
                scale * (bits >> 40) as f32 / 16_777_216.0
            };
            let own = (case as usize * 5) % count;
            let [first, second] = plans(&goal, width, count, |at, n| error(0, at, n));
            let mut others = 0;
            for seed in 1..6 {
                let found = plans(&goal, width, count, |at, n| {
                    error(if at == own { seed } else { 0 }, at, n)
                });
                assert_eq!((found[0][own], found[1][own]), (first[own], second[own]), "{case}");
                others += usize::from(found[1] != second);
            }
            // The samples must matter to other pixels, or the test shows nothing.
            assert!(case % 8 > 0 || others > 0 || second.iter().all(|&n| n == 1024), "{case}");
        }
    }

    #[test]
    fn sample_counts_stay_within_their_limits() {
        let [_, second] = plans(&goal(Relative::Pixel), 4, 16, |_, _| 268_435_456.0);
        assert_eq!(second, [1024; 16]);
        assert_eq!(plans(&goal(Relative::Pixel), 1, 1, |_, _| 1e6), [[16], [16]]);
    }
}
