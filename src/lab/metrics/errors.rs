//! Errors of one list of values against another: means over all values of all channels, in f64.

/// Errors of values x against reference values r, d = x - r.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueErrors {
    /// Mean squared error: mean d^2.
    pub mse: f64,
    /// Mean absolute error: mean |d|.
    pub mae: f64,
    /// Relative squared error: mean d^2 / (r^2 + 0.01). The relMSE of tev and most papers
    /// (Rousselle et al. 2011).
    pub relmse: f64,
    /// Relative squared error: mean (d / (|r| + 0.01))^2. The MRSE of pbrt's `imgtool`, where r is
    /// never negative.
    pub mrse: f64,
    /// Symmetric absolute error: mean |d| / (|x| + |r| + 0.01). The SMAPE of the denoising papers
    /// (Bako et al. 2017).
    pub smape: f64,
    /// Bias, the mean signed error: mean d.
    pub bias: f64,
    /// Largest error: max |d|.
    pub max: f64,
    /// 99th percentile of |d|: the smallest |d| that 99% of all |d| do not exceed.
    pub p99: f64,
    /// Fraction of values that are not equal.
    pub differ: f64,
}

impl ValueErrors {
    /// Term in denominators that keeps relative errors finite where the reference is dark.
    pub const EPSILON: f64 = 0.01;

    /// Computes all errors of two lists of the same length, without NaN and infinities.
    ///
    /// Empty lists have zero errors.
    pub fn of(test: &[f32], reference: &[f32]) -> Self {
        let mut sums = [0.0; 7];
        let mut distances = Vec::with_capacity(test.len());
        for (&x, &r) in test.iter().zip(reference) {
            let (x, r) = (f64::from(x), f64::from(r));
            let d = x - r;
            let terms = [
                d * d,
                d.abs(),
                d * d / (r * r + Self::EPSILON),
                (d / (r.abs() + Self::EPSILON)).powi(2),
                d.abs() / (x.abs() + r.abs() + Self::EPSILON),
                d,
                f64::from(u8::from(x != r)),
            ];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term;
            }
            distances.push(d.abs());
        }
        let [mse, mae, relmse, mrse, smape, bias, differ] =
            sums.map(|sum| sum / test.len().max(1) as f64);
        let max = distances.iter().copied().fold(0.0, f64::max);
        let p99 = percentile(&mut distances, 99);
        Self { mse, mae, relmse, mrse, smape, bias, max, p99, differ }
    }
}

/// The smallest value that `percent` percent of all values do not exceed; 0 if there are none.
fn percentile(values: &mut [f64], percent: usize) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let rank = (values.len() * percent).div_ceil(100).max(1);
    *values.select_nth_unstable_by(rank - 1, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1e-3), "{a} {b}");
    }

    #[test]
    fn errors_of_known_values_in_closed_form() {
        // d = 0.5, -0.25, 0, 1; all exact in f32.
        let (x, r) = ([1.0, 0.25, 2.0, 1.0], [0.5, 0.5, 2.0, 0.0]);
        let e = ValueErrors::of(&x, &r);
        near(e.mse, (0.25 + 0.0625 + 1.0) / 4.0);
        near(e.mae, 1.75 / 4.0);
        near(e.bias, 1.25 / 4.0);
        near(e.relmse, (0.25 / 0.26 + 0.0625 / 0.26 + 1.0 / 0.01) / 4.0);
        near(e.mrse, (0.25 / 0.2601 + 0.0625 / 0.2601 + 1.0 / 0.0001) / 4.0);
        near(e.smape, (0.5 / 1.51 + 0.25 / 0.76 + 1.0 / 1.01) / 4.0);
        near(e.max, 1.0);
        near(e.differ, 0.75);
    }

    #[test]
    fn white_against_black_and_equal_values() {
        let e = ValueErrors::of(&[1.0; 12], &[0.0; 12]);
        for (value, expected) in [(e.mse, 1.0), (e.mae, 1.0), (e.relmse, 100.0), (e.mrse, 1e4)] {
            near(value, expected);
        }
        near(e.smape, 1.0 / 1.01);
        let zero = ValueErrors::of(&[0.3, -7.0], &[0.3, -7.0]);
        let all = [zero.mse, zero.relmse, zero.mrse, zero.smape, zero.bias, zero.max, zero.p99];
        assert_eq!(all, [0.0; 7]);
        assert_eq!(ValueErrors::of(&[], &[]).mse, 0.0);
    }

    #[test]
    fn the_bias_is_positive_for_a_brighter_picture() {
        near(ValueErrors::of(&[1.5, 1.0], &[1.0, 1.0]).bias, 0.25);
        near(ValueErrors::of(&[0.5, 1.0], &[1.0, 1.0]).bias, -0.25);
    }

    #[test]
    fn p99_ignores_one_value_of_a_hundred() {
        let reference = [0.0; 200];
        let mut x = [0.0; 200];
        x[7] = 5.0;
        x[9] = 4.0;
        assert_eq!(ValueErrors::of(&x, &reference).p99, 0.0);
        x[11] = 3.0;
        assert_eq!(ValueErrors::of(&x, &reference).p99, 3.0);
        assert_eq!(ValueErrors::of(&[2.0], &[0.0]).p99, 2.0);
    }
}
