//! Robust statistics of repeated timings: medians, their spread, and confidence intervals.
//!
//! With ten samples or more, intervals assume no distribution.

use serde::{Deserialize, Serialize};

use super::random::Random;

/// Number of resamples of a bootstrap.
const RESAMPLES: usize = 2000;

/// Smallest number of samples for a bootstrap interval.
const ENOUGH: usize = 10;

/// Upper 2.5 % points of Student's t distribution with 1, 2, ... degrees of freedom.
const STUDENT: [f64; ENOUGH - 2] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306];

/// A value and its 95 % confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value computed from the samples.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Estimate {
    /// Converts a time to a rate: `n / self`, with the ends of the interval swapped.
    pub fn rate(&self, n: f64) -> Self {
        Self { value: n / self.value, low: n / self.high, high: n / self.low }
    }
}

/// The median: for an even number of values the mean of the middle two. NaN if there are none.
pub fn median(values: &[f64]) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    match v.len() {
        0 => f64::NAN,
        n => (v[(n - 1) / 2] + v[n / 2]) / 2.0,
    }
}

/// Median absolute deviation from the median, not scaled.
pub fn mad(values: &[f64]) -> f64 {
    let m = median(values);
    median(&values.iter().map(|x| (x - m).abs()).collect::<Vec<_>>())
}

/// The median of `values` with its 95 % interval.
///
/// - Ten values or more: percentiles of the medians of resamples, a bootstrap (Efron 1979). The
///   seed is fixed, so the same samples give the same interval.
/// - Fewer values, all > 0: the interval of Student's t for their logarithms. A bootstrap interval
///   would be too narrow.
/// - One value: the value itself.
pub fn median_interval(values: &[f64]) -> Estimate {
    if values.len() < ENOUGH {
        let logs: Vec<f64> = values.iter().map(|x| x.ln()).collect();
        let half = student(logs.len()) * standard_error(&logs);
        return around(median(values), mean(&logs), half);
    }
    let mut random = Random::from_state(1);
    let medians = (0..RESAMPLES).map(|_| median(&resample(&mut random, values)));
    percentiles(median(values), medians.collect())
}

/// Speed of B relative to A from times that were taken in pairs: the median of `a[i] / b[i]`.
///
/// A disturbance that slows both times of a pair cancels.
pub fn paired_ratio(a: &[f64], b: &[f64]) -> Estimate {
    let ratios: Vec<f64> = a.iter().zip(b).map(|(a, b)| a / b).collect();
    median_interval(&ratios)
}

/// Speed of B relative to A from times that were not taken in pairs: the ratio of medians.
///
/// With fewer than ten values on either side, the interval is Welch's t of the logarithms. It takes
/// the degrees of freedom of the smaller set.
pub fn unpaired_ratio(a: &[f64], b: &[f64]) -> Estimate {
    let fewer = a.len().min(b.len());
    if fewer < ENOUGH {
        let [la, lb] = [a, b].map(|v| v.iter().map(|x| x.ln()).collect::<Vec<_>>());
        let half = student(fewer) * standard_error(&la).hypot(standard_error(&lb));
        return around(median(a) / median(b), mean(&la) - mean(&lb), half);
    }
    let mut random = Random::from_state(1);
    let ratio = |a: &[f64], b: &[f64]| median(a) / median(b);
    let ratios =
        (0..RESAMPLES).map(|_| ratio(&resample(&mut random, a), &resample(&mut random, b)));
    percentiles(ratio(a, b), ratios.collect())
}

/// The mean; NaN if there are no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Standard error of the mean; 0 for one value.
fn standard_error(values: &[f64]) -> f64 {
    let (n, mean) = (values.len() as f64, mean(values));
    let squares: f64 = values.iter().map(|x| (x - mean) * (x - mean)).sum();
    (squares / ((n - 1.0).max(1.0) * n)).sqrt()
}

/// The factor of Student's t for the mean of n < [`ENOUGH`] values; 0 for one value.
fn student(n: usize) -> f64 {
    n.checked_sub(2).and_then(|i| STUDENT.get(i)).copied().unwrap_or(0.0)
}

/// Returns `value` with the interval from exp(`log` - `half`) to exp(`log` + `half`).
///
/// `log` is a mean of logarithms. `value` is a median, which may lie outside the interval. Then the
/// interval is widened to contain it.
fn around(value: f64, log: f64, half: f64) -> Estimate {
    Estimate { value, low: value.min((log - half).exp()), high: value.max((log + half).exp()) }
}

fn percentiles(value: f64, mut values: Vec<f64>) -> Estimate {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    Estimate { value, low: at(0.025), high: at(0.975) }
}

/// Draws `values.len()` of the values at random, with replacement.
fn resample(random: &mut Random, values: &[f64]) -> Vec<f64> {
    let n = values.len() as u64;
    values.iter().map(|_| values[(random.bits() % n) as usize]).collect()
}

/// Fit of a power law y = c x^exponent to points: a line through their logarithms.
pub struct LogFit {
    /// Mean logarithms of x and y.
    pub mean: [f64; 2],
    /// Sum of the squared deviations of log x from its mean.
    pub xx: f64,
    /// Exponent of x: the slope of the line. NaN if all x are the same.
    pub exponent: f64,
}

/// Fits a power law to points with coordinates > 0, by least squares of log y over log x.
pub fn log_fit(points: &[[f64; 2]]) -> LogFit {
    let logs: Vec<[f64; 2]> = points.iter().map(|point| point.map(f64::ln)).collect();
    let [x, y] = [0, 1].map(|k| logs.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64);
    let xx: f64 = logs.iter().map(|p| (p[0] - x) * (p[0] - x)).sum();
    let xy: f64 = logs.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    LogFit { mean: [x, y], xx, exponent: xy / xx }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn holds_one(ratio: &Estimate) -> bool {
        ratio.low <= 1.0 && 1.0 <= ratio.high
    }

    #[test]
    fn medians_and_deviations_of_known_values() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
        // Deviations from 2: 1, 1, 0, 0, 2, 4, 7.
        assert_eq!(mad(&[1.0, 1.0, 2.0, 2.0, 4.0, 6.0, 9.0]), 1.0);
        assert_eq!(mad(&[5.0; 4]), 0.0);
    }

    #[test]
    fn constant_samples_have_an_interval_of_one_point() {
        let all = Estimate { value: 7.0, low: 7.0, high: 7.0 };
        assert_eq!(median_interval(&[7.0; 19]), all);
        let twice = Estimate { value: 2.0, low: 2.0, high: 2.0 };
        assert_eq!(paired_ratio(&[4.0; 12], &[2.0; 12]), twice);
        assert_eq!(unpaired_ratio(&[4.0; 13], &[2.0; 15]), twice);
        for few in [
            paired_ratio(&[4.0, 8.0, 2.0], &[2.0, 4.0, 1.0]),
            unpaired_ratio(&[4.0; 3], &[2.0; 5]),
            median_interval(&[2.0]),
        ] {
            assert_eq!(few.value, 2.0);
            assert!((few.low - 2.0).abs() < 1e-12 && (few.high - 2.0).abs() < 1e-12, "{few:?}");
        }
        assert!(!holds_one(&twice));
        assert_eq!(twice.rate(6.0), Estimate { value: 3.0, low: 3.0, high: 3.0 });
    }

    /// By the binomial distribution, the interval of the median of 1..=30 runs from the 10th to the
    /// 21st value (Conover 1999, section 3.2). The bootstrap is within one value of it.
    #[test]
    fn a_bootstrap_interval_is_near_that_of_order_statistics() {
        let values: Vec<f64> = (1..=30).map(f64::from).collect();
        let estimate = median_interval(&values);
        assert_eq!(estimate.value, 15.5);
        assert!((estimate.low - 10.0).abs() <= 1.0, "{estimate:?}");
        assert!((estimate.high - 21.0).abs() <= 1.0, "{estimate:?}");
    }

    /// About 95 % of the 95 % intervals contain the true ratio: of 400, between 360 and 396.
    ///
    /// The limits are wide because the bootstrap of a median of 30 values is a little off. The
    /// seeds are fixed, so the result does not vary.
    #[test]
    fn bootstrap_intervals_contain_the_truth_as_often_as_promised() {
        let mut random = Random::from_state(9);
        let mut uniform = || random.unit();
        let held = (0..400).filter(|_| {
            let a: Vec<f64> = (0..30).map(|_| 1.0 + uniform()).collect();
            let b: Vec<f64> = (0..30).map(|_| 1.0 + uniform()).collect();
            holds_one(&unpaired_ratio(&a, &b))
        });
        let held = held.count();
        assert!((360..=396).contains(&held), "{held}");
    }

    /// At least 93 % of 2000 intervals from 2 to 9 values contain the true ratio.
    #[test]
    fn intervals_of_few_values_contain_the_truth_as_often_as_promised() {
        let mut random = Random::from_state(5);
        let mut noisy = || {
            let twelve = (0..12).map(|_| random.unit());
            // The sum of twelve uniform numbers is nearly normal.
            (0.1 * (twelve.sum::<f64>() - 6.0)).exp()
        };
        for n in 2..=9 {
            let mut values = || (0..n).map(|_| noisy()).collect::<Vec<f64>>();
            let (mut paired, mut unpaired) = (0, 0);
            for _ in 0..2000 {
                let (a, b) = (values(), values());
                paired += usize::from(holds_one(&paired_ratio(&a, &b)));
                unpaired += usize::from(holds_one(&unpaired_ratio(&a, &b)));
            }
            assert!(paired >= 1860 && unpaired >= 1860, "{n}: {paired}, {unpaired}");
        }
    }

    /// The logarithms of 1, 2 and 4 are 0, 1 and 2 times ln 2. Their standard error is ln 2 /
    /// sqrt(3).
    #[test]
    fn the_interval_of_three_values_is_students_t() {
        let estimate = median_interval(&[1.0, 2.0, 4.0]);
        let half = 4.303 / 3f64.sqrt();
        assert!((estimate.low - 2f64.powf(1.0 - half)).abs() < 1e-12, "{estimate:?}");
        assert!((estimate.high - 2f64.powf(1.0 + half)).abs() < 1e-12, "{estimate:?}");
    }

    #[test]
    fn a_disturbance_of_both_times_of_a_pair_cancels() {
        let noise = [1.0, 3.0, 1.2, 9.0, 1.1, 1.0, 2.0, 5.0];
        let a: Vec<f64> = noise.iter().map(|n| 1.25 * n).collect();
        let ratio = paired_ratio(&a, &noise);
        assert!((ratio.low - 1.25).abs() < 1e-12 && (ratio.high - 1.25).abs() < 1e-12);
        assert!(holds_one(&unpaired_ratio(&a, &noise)));
    }
}
