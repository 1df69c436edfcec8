//! The reference of a study: a file, or the mean of several passes with an estimate of its error.

use crate::lab::metrics::ValueErrors;

/// Expected contribution of the reference's own error to measured errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceError {
    /// Contribution to the mean squared error.
    pub mse: f64,
    /// Contribution to the relative squared error.
    pub relmse: f64,
}

/// A picture that errors are measured against.
#[derive(Debug, Clone)]
pub struct ReferencePicture {
    /// R, G, B of all pixels.
    pub values: Vec<f32>,
    /// Contribution of its own error; `None` if it is unknown.
    pub floor: Option<ReferenceError>,
}

/// Sums and squares of independent passes.
#[derive(Debug, Clone, Default)]
pub struct PassSums {
    sums: Vec<f64>,
    squares: Vec<f64>,
    /// Number of passes so far.
    pub count: u32,
}

impl PassSums {
    /// Adds one pass: R, G, B of all pixels.
    pub fn add(&mut self, values: &[f32]) {
        self.sums.resize(values.len(), 0.0);
        self.squares.resize(values.len(), 0.0);
        for ((sum, square), value) in self.sums.iter_mut().zip(&mut self.squares).zip(values) {
            let value = f64::from(*value);
            *sum += value;
            *square += value * value;
        }
        self.count += 1;
    }

    /// The mean of all passes as a reference, with its error.
    ///
    /// The variance of the mean is the variance between passes, divided by their number. With one
    /// pass it is unknown.
    pub fn mean(&self) -> ReferencePicture {
        let n = f64::from(self.count);
        let (mut mse, mut relmse) = (0.0, 0.0);
        let mut values = Vec::with_capacity(self.sums.len());
        for (sum, square) in self.sums.iter().zip(&self.squares) {
            let mean = sum / n;
            let variance = ((square - sum * mean) / (n - 1.0) / n).max(0.0);
            mse += variance;
            relmse += variance / (mean * mean + ValueErrors::EPSILON);
            values.push(mean as f32);
        }
        let count = values.len().max(1) as f64;
        let floor = ReferenceError { mse: mse / count, relmse: relmse / count };
        ReferencePicture { values, floor: (self.count > 1).then_some(floor) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::random::Random;

    /// Averages passes with a known error.
    #[test]
    fn the_floor_is_the_error_of_the_mean() {
        let mut random = Random::new(3, 0);
        let truth: Vec<f64> = (0..30_000).map(|i| f64::from(i % 7) * 0.3).collect();
        let mut passes = PassSums::default();
        for _ in 0..4 {
            let noisy = truth.iter().map(|t| (t + 0.02 * (random.unit() - 0.5)) as f32);
            passes.add(&noisy.collect::<Vec<f32>>());
        }
        let reference = passes.mean();
        let exact: Vec<f32> = truth.iter().map(|t| *t as f32).collect();
        let errors = ValueErrors::of(&reference.values, &exact);
        let floor = reference.floor.unwrap();
        assert!((floor.mse / errors.mse - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
        assert!((floor.relmse / errors.relmse - 1.0).abs() < 0.05, "{floor:?} {errors:?}");
        // The variance of a uniform number of width 0.02, divided by 4 passes.
        assert!((floor.mse / (0.02f64.powi(2) / 12.0 / 4.0) - 1.0).abs() < 0.05);
    }
}
