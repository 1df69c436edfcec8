//! Robust statistics of repeated timings: medians, their spread, and intervals without a model.

use serde::{Deserialize, Serialize};

/// Resamples of a bootstrap.
const RESAMPLES: usize = 2000;

/// A value and its 95 % confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value of the samples themselves.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Estimate {
    /// Whether a ratio's interval holds 1: then no difference is shown.
    pub fn holds_one(&self) -> bool {
        self.low <= 1.0 && 1.0 <= self.high
    }

    /// `n / self`: a rate from a time; the ends change places.
    pub fn rate(&self, n: f64) -> Self {
        Self { value: n / self.value, low: n / self.high, high: n / self.low }
    }
}

/// The median; of an even number of values the mean of the middle two. NaN of no values.
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

/// The median with its interval: percentiles of the medians of resamples (Efron 1979), by a fixed
/// seed, so that the same samples give the same interval.
pub fn median_interval(values: &[f64]) -> Estimate {
    let mut random = Random(1);
    let medians = (0..RESAMPLES).map(|_| median(&random.resample(values)));
    percentiles(median(values), medians.collect())
}

/// How many times faster B is than A, from times taken side by side: the median of `a[i] / b[i]`.
/// What slows both of a pair drops out.
pub fn paired_ratio(a: &[f64], b: &[f64]) -> Estimate {
    let ratios: Vec<f64> = a.iter().zip(b).map(|(a, b)| a / b).collect();
    median_interval(&ratios)
}

/// The same from times that were not taken side by side: the ratio of medians.
pub fn unpaired_ratio(a: &[f64], b: &[f64]) -> Estimate {
    let mut random = Random(1);
    let ratio = |a: &[f64], b: &[f64]| median(a) / median(b);
    let ratios = (0..RESAMPLES).map(|_| ratio(&random.resample(a), &random.resample(b)));
    percentiles(ratio(a, b), ratios.collect())
}

fn percentiles(value: f64, mut values: Vec<f64>) -> Estimate {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    Estimate { value, low: at(0.025), high: at(0.975) }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    fn resample(&mut self, values: &[f64]) -> Vec<f64> {
        let n = values.len() as u64;
        values.iter().map(|_| values[(self.next() % n) as usize]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_medians() {
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
        assert_eq!(median_interval(&[7.0; 9]), all);
        let twice = Estimate { value: 2.0, low: 2.0, high: 2.0 };
        assert_eq!(paired_ratio(&[4.0, 8.0, 2.0], &[2.0, 4.0, 1.0]), twice);
        assert_eq!(unpaired_ratio(&[4.0; 3], &[2.0; 5]), twice);
        assert!(!twice.holds_one());
        assert_eq!(twice.rate(6.0), Estimate { value: 3.0, low: 3.0, high: 3.0 });
    }

    /// The interval of the median of 1..=30 by the binomial distribution runs from the 10th to the
    /// 21st value (Conover 1999, section 3.2): the bootstrap is within one value of it.
    #[test]
    fn an_interval_is_that_of_order_statistics() {
        let values: Vec<f64> = (1..=30).map(f64::from).collect();
        let estimate = median_interval(&values);
        assert_eq!(estimate.value, 15.5);
        assert!((estimate.low - 10.0).abs() <= 1.0, "{estimate:?}");
        assert!((estimate.high - 21.0).abs() <= 1.0, "{estimate:?}");
    }

    /// Of 95 % intervals for the median of known distributions, about 95 % hold it: of 400, between
    /// 360 and 396 (the bootstrap of a median of 30 is a little off, and this is no test of luck:
    /// the seeds are fixed).
    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say() {
        let mut random = Random(9);
        let mut uniform = || (random.next() >> 11) as f64 / (1u64 << 53) as f64;
        let held = (0..400).filter(|_| {
            let a: Vec<f64> = (0..30).map(|_| 1.0 + uniform()).collect();
            let b: Vec<f64> = (0..30).map(|_| 1.0 + uniform()).collect();
            unpaired_ratio(&a, &b).holds_one()
        });
        let held = held.count();
        assert!((360..=396).contains(&held), "{held}");
    }

    #[test]
    fn what_slows_both_of_a_pair_drops_out() {
        let noise = [1.0, 3.0, 1.2, 9.0, 1.1, 1.0, 2.0, 5.0];
        let a: Vec<f64> = noise.iter().map(|n| 1.25 * n).collect();
        let ratio = paired_ratio(&a, &noise);
        assert!((ratio.low - 1.25).abs() < 1e-12 && (ratio.high - 1.25).abs() < 1e-12);
        assert!(unpaired_ratio(&a, &noise).holds_one());
    }
}
