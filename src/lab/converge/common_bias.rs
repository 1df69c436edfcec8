//! Notices a reference of another picture: all settings then have the same bias.

use super::result::{MeanWithError, PointResult, StudyReport};
use crate::lab::stats::mean;

/// Least number of standard errors that a bias of all settings has.
const BIAS_ERRORS: f64 = 10.0;

/// Largest deviation of a setting from the bias of all, relative to it.
const BIAS_SPREAD: f64 = 0.1;

/// Least share of a bias of all settings in the smallest RMSE. An exact reference has a smaller
/// one.
const BIAS_SHARE: f64 = 0.2;

impl StudyReport {
    /// Mean signed error that all settings share, if it is most likely that of the reference: it is
    /// far beyond the noise, does not depend on the number of samples, and is more than the
    /// rounding of a reference in 16 bits explains.
    pub fn common_bias(&self) -> Option<f64> {
        let points = || self.points.iter().filter(|point| !point.not_antialiased);
        let common = mean(&points().map(|point| point.bias.value).collect::<Vec<_>>());
        let shared = |point: &PointResult| {
            let MeanWithError { value, standard_error } = point.bias;
            standard_error.is_some_and(|error| value.abs() > BIAS_ERRORS * error)
                && (value - common).abs() <= BIAS_SPREAD * common.abs()
        };
        let least = points().map(|point| point.rmse.value).fold(f64::INFINITY, f64::min);
        let rounding = (1.0 + BIAS_SPREAD) * self.reference.largest_half_bias.unwrap_or(0.0);
        let is_large = common.abs() > rounding.max(BIAS_SHARE * least);
        (points().all(shared) && is_large).then_some(common)
    }
}
