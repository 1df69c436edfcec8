//! Expected errors of a picture by rounding to 16-bit floats alone.

use crate::lab::metrics::ValueErrors;

/// Expected errors of two pictures that differ only by rounding to half floats.
///
/// A value that may lie anywhere between two half floats has an expected squared error of
/// step^2 / 12.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfRounding {
    /// Expected root mean squared error, as
    /// [`Metric::Rmse`](crate::lab::metrics::Metric::Rmse).
    pub rmse: f64,
    /// Expected relative squared error, as
    /// [`Metric::Relmse`](crate::lab::metrics::Metric::Relmse).
    pub relmse: f64,
}

impl HalfRounding {
    /// Expected errors of a picture and its reference, in this order. `half` says which of them is
    /// stored as half floats.
    pub fn of([test, reference]: [&[f32]; 2], half: [bool; 2]) -> Self {
        let (mut square, mut relative) = (0.0, 0.0);
        for (x, r) in test.iter().zip(reference) {
            let (x, r) = (f64::from(*x), f64::from(*r));
            let stored = [x, r].into_iter().zip(half).filter(|(_, half)| *half);
            let variance: f64 = stored.map(|(value, _)| step(value).powi(2) / 12.0).sum();
            square += variance;
            relative += variance / (r * r + ValueErrors::EPSILON);
        }
        let count = reference.len().max(1) as f64;
        Self { rmse: (square / count).sqrt(), relmse: relative / count }
    }
}

/// Largest absolute mean error of values by rounding them to half floats: half a step of each.
pub fn largest_bias(values: &[f32]) -> f64 {
    let steps: f64 = values.iter().map(|value| step(f64::from(*value))).sum();
    steps / 2.0 / values.len().max(1) as f64
}

/// Distance between half floats around a value: 10 bits below its first bit, at least 2^-24.
fn step(value: f64) -> f64 {
    let exponent = value.abs().max(2f64.powi(-14)).log2().floor();
    (exponent - 10.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::half::f16;

    #[test]
    fn the_floor_is_the_error_of_rounding() {
        let values: Vec<f32> =
            (0..40_000).map(|i| ((f64::from(i) * 0.618_033_988_7).fract() * 3.0) as f32).collect();
        let rounded: Vec<f32> = values.iter().map(|v| f16::from_f32(*v).to_f32()).collect();
        let errors = ValueErrors::of(&rounded, &values);
        let floor = HalfRounding::of([&rounded, &values], [true, false]);
        assert!((floor.rmse / errors.mse.sqrt() - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
        assert!((floor.relmse / errors.relmse - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
    }

    /// Each file is rounded where its own value lies.
    #[test]
    fn each_file_has_the_steps_of_its_own_values() {
        let pair: [&[f32]; 2] = [&[1000.0], &[1.0]];
        let rmse = |half| HalfRounding::of(pair, half).rmse;
        assert_eq!(rmse([true, false]), (0.25f64 / 12.0).sqrt());
        assert_eq!(rmse([false, true]), (2f64.powi(-20) / 12.0).sqrt());
        let both = rmse([true, false]).hypot(rmse([false, true]));
        assert!((rmse([true, true]) / both - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_mean_error_is_at_most_half_a_step() {
        // The first lies in the middle between two half floats, 0.25 is one itself.
        let values = [1.0 + 2f32.powi(-11), 0.1, 0.25];
        let rounded = values.map(|value| f16::from_f32(value).to_f32());
        let bound = largest_bias(&rounded);
        assert_eq!(bound, (2f64.powi(-11) + 2f64.powi(-15) + 2f64.powi(-13)) / 3.0);
        assert!(ValueErrors::of(&values, &rounded).bias.abs() <= bound);
        assert_eq!(ValueErrors::of(&values[..1], &rounded[..1]).bias, largest_bias(&rounded[..1]));
        assert_eq!(largest_bias(&[]), 0.0);
    }

    #[test]
    fn steps_between_half_floats() {
        for (value, expected) in [(1.0, -10), (-1.5, -10), (2.0, -9), (0.0, -24), (1e-6, -24)] {
            assert_eq!(step(value), 2f64.powi(expected), "{value}");
        }
    }
}
