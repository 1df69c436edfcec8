//! Fits power laws, and finds the Pareto front of cost and error.

use serde::{Deserialize, Serialize};

use crate::lab::stats::{LogFit, log_fit};

/// A power law y = c x^slope, fitted to points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// The exponent of x.
    pub slope: f64,
    /// Standard error of the exponent: from the residuals or from the standard errors of the
    /// points, whichever is larger. Few points have small residuals by chance.
    pub standard_error: f64,
    /// The factor c of the power law.
    pub factor: f64,
    /// Number of points of the fit.
    pub points: usize,
}

/// Fits a power law by least squares of log y over log x. `errors` are the relative standard errors
/// of the y, 0 where unknown.
///
/// `None` for fewer than 3 points, a value that is not > 0 and finite, or points with one common x.
pub fn slope(points: &[[f64; 2]], errors: &[f64]) -> Option<Slope> {
    let n = points.len() as f64;
    if points.len() < 3 || points.iter().flatten().any(|v| !(*v > 0.0 && v.is_finite())) {
        return None;
    }
    let LogFit { mean: [x, y], xx, exponent: slope } = log_fit(points);
    if xx == 0.0 {
        return None;
    }
    let residual = |p: &[f64; 2]| (p[1].ln() - y - slope * (p[0].ln() - x)).powi(2);
    let squares: f64 = points.iter().map(residual).sum();
    let scatter = (squares / (n - 2.0) / xx).sqrt();
    let moved = |(p, error): (&[f64; 2], &f64)| ((p[0].ln() - x) * error).powi(2);
    let propagated = points.iter().zip(errors).map(moved).sum::<f64>().sqrt() / xx;
    Some(Slope {
        slope,
        standard_error: scatter.max(propagated),
        factor: (y - slope * x).exp(),
        points: points.len(),
    })
}

/// Returns the Pareto front of points (cost, error): the indices of all points with a smaller error
/// than every point of at most their cost. The cheapest comes first. Of equal points one is kept.
pub fn front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        let [[ca, ea], [cb, eb]] = [points[a], points[b]];
        ca.total_cmp(&cb).then(ea.total_cmp(&eb))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i][1] < best;
        best = best.min(points[i][1]);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_recovered_with_its_standard_error() {
        let exact: Vec<[f64; 2]> =
            (1..6).map(|i| 4f64.powi(i)).map(|x| [x, 3.0 * x.powf(-0.75)]).collect();
        let found = slope(&exact, &[0.0; 5]).unwrap();
        assert!((found.slope + 0.75).abs() < 1e-12 && (found.factor - 3.0).abs() < 1e-9);
        assert!(found.standard_error < 1e-7);
        // Residuals of +-0.1 about y = x^-1 at ln x = 0, 1, 2, 3, in closed form.
        let e = std::f64::consts::E;
        let off = [0.1, -0.1, -0.1, 0.1];
        let points: Vec<[f64; 2]> =
            (0..4).map(|i| [e.powi(i), (off[i as usize] - f64::from(i)).exp()]).collect();
        let found = slope(&points, &[0.0; 4]).unwrap();
        assert!((found.slope + 1.0).abs() < 1e-12);
        assert!((found.standard_error - (0.04f64 / 2.0 / 5.0).sqrt()).abs() < 1e-12);
        // Points on a line by chance: only their own errors remain. At ln x = 0, 1, 2 the middle
        // one does not matter.
        let line: Vec<[f64; 2]> = (0..3).map(|i| [e.powi(i), e.powi(-i)]).collect();
        let found = slope(&line, &[0.03, 0.5, 0.04]).unwrap();
        assert!((found.standard_error - 0.05 / 2.0).abs() < 1e-12, "{found:?}");
        assert_eq!(slope(&points[..2], &[0.0; 2]), None);
        assert_eq!(slope(&[[1.0, 1.0], [2.0, 0.0], [4.0, 1.0]], &[0.0; 3]), None);
        assert_eq!(slope(&[[2.0, 1.0]; 3], &[0.0; 3]), None);
    }

    #[test]
    fn the_front_has_no_dominated_point() {
        let points = [[1.0, 5.0], [2.0, 6.0], [2.0, 3.0], [4.0, 1.0], [3.0, 3.0], [1.0, 7.0]];
        assert_eq!(front(&points), [0, 2, 3]);
        assert_eq!(front(&[]), [0usize; 0]);
    }
}
