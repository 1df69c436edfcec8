//! Checks the 4 x 4 matrices of the format.

use glam::{DAffine3, DMat3, DVec3};

use crate::math::condition;
use crate::scene::description::Matrix;

/// Largest condition number of the transform of an instance. The limit keeps rounding small beside
/// the boxes of the mesh: see [`crate::geometry::Placement`].
const MAX_CONDITION: f64 = 1e6;

/// Largest and smallest scale of an instance.
const MAX_SCALE: f64 = 1e18;

/// A message and a help text.
pub type Refusal = (String, Option<&'static str>);

/// Splits a matrix into its upper left 3 x 3 part and its last column.
///
/// # Errors
/// If the last row is not 0 0 0 1.
pub fn split(Matrix(rows): &Matrix) -> Result<(DMat3, DVec3), Refusal> {
    let [r0, r1, r2, last] = *rows;
    if last != [0.0, 0.0, 0.0, 1.0] {
        let transposed = [r0[3], r1[3], r2[3], last[3]] == [0.0, 0.0, 0.0, 1.0];
        let help = transposed.then_some("the matrix looks transposed: swap its rows and columns");
        return Err((format!("found the last row {last:?}, expected [0, 0, 0, 1]"), help));
    }
    let column = |k: usize| DVec3::new(r0[k], r1[k], r2[k]);
    Ok((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}

/// Returns the transform of an instance.
///
/// # Errors
/// If the matrix is singular, or nearly so, or scales beyond 1e-18 to 1e18.
pub fn affine(matrix: &Matrix) -> Result<DAffine3, Refusal> {
    let (linear, offset) = split(matrix)?;
    let condition = condition(&linear);
    if !condition.is_finite() {
        let message = "found a singular matrix, expected one that has an inverse";
        return Err((message.into(), Some("it flattens the mesh")));
    }
    if condition > MAX_CONDITION {
        let message = format!(
            "found a nearly singular matrix, of condition number {condition:.1e}, expected at most {MAX_CONDITION:e}"
        );
        return Err((message, Some("it flattens the mesh")));
    }
    let scale = linear.to_cols_array().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    if !(1.0 / MAX_SCALE..=MAX_SCALE).contains(&scale) {
        let range = format!("{:e} to {MAX_SCALE:e}", 1.0 / MAX_SCALE);
        return Err((format!("found a matrix of scale {scale:.1e}, expected {range}"), None));
    }
    Ok(DAffine3::from_mat3_translation(linear, offset))
}
