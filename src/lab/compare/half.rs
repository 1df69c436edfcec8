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
    /// Expected errors for `values` that are stored as half floats in `files` (1 or 2) of the
    /// files.
    pub fn of(values: &[f32], files: u32) -> Self {
        let (mut square, mut relative) = (0.0, 0.0);
        for value in values {
            let value = f64::from(*value);
            let variance = step(value).powi(2) / 12.0;
            square += variance;
            relative += variance / (value * value + ValueErrors::EPSILON);
        }
        let scale = f64::from(files) / values.len().max(1) as f64;
        Self { rmse: (square * scale).sqrt(), relmse: relative * scale }
    }
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
        let floor = HalfRounding::of(&values, 1);
        assert!((floor.rmse / errors.mse.sqrt() - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
        assert!((floor.relmse / errors.relmse - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
    }

    #[test]
    fn steps_between_half_floats() {
        for (value, expected) in [(1.0, -10), (-1.5, -10), (2.0, -9), (0.0, -24), (1e-6, -24)] {
            assert_eq!(step(value), 2f64.powi(expected), "{value}");
        }
    }
}
