//! Checks calibrated cameras. The pose must be a rotation and a translation, the intrinsics must
//! belong to the frame, and the distortion must not fold inside the frame.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use crate::calibration::{Calibration, Distortion, Fold, Model, shared_inverse};
use crate::scene::checked::Projection;
use crate::scene::description::{Axes, DistortionDescription, Intrinsics, Matrix};
use crate::scene::node::JsonPlace;

use super::affine::{Refusal, split};
use super::camera::CameraPose;
use super::context::Check;

/// Maximum entry of R R^T - 1 up to which a matrix R counts as a rotation. Matrices with rounded
/// digits pass; the nearest rotation is used.
const MAX_DEVIATION: f64 = 1e-4;

impl Check<'_, '_> {
    /// Checks intrinsics and distortion. `sized` is false if the frame has too many pixels; then
    /// the distortion is not checked.
    pub(super) fn calibrated(&mut self, camera: &Intrinsics, sized: bool) -> Option<Projection> {
        self.size_of_intrinsics();
        let size = [camera.width, camera.height].map(f64::from);
        // OpenCV's pixel centres are whole numbers.
        let principal = [(camera.cx, size[0]), (camera.cy, size[1])]
            .map(|(c, side)| c.map_or(side / 2.0, |c| c + 0.5));
        let focal = [camera.fx, camera.fy.unwrap_or(camera.fx)];
        let calibration = Calibration { focal, principal, skew: camera.skew };
        for (k, key) in ["cx", "cy"].into_iter().enumerate() {
            if !(0.0..=size[k]).contains(&principal[k]) {
                let message = format!(
                    "found a principal point outside of the frame of {} x {} pixels",
                    camera.width, camera.height
                );
                let help = "are these the intrinsics of a picture of another size?";
                self.problems.warn(&format!("/camera/{key}"), message, Some(help.into()));
            }
        }
        let Some(distortion) = camera.distortion.map(|d| distortion(&d)) else {
            return Some(Projection::Calibrated(calibration));
        };
        // Nothing can be inverted with numbers that are out of range.
        let is_bad = |key| self.problems.has_error(&format!("/camera/{key}"));
        if !sized || ["fx", "fy", "cx", "cy", "skew"].into_iter().any(is_bad) {
            return None;
        }
        match shared_inverse(calibration, distortion, [camera.width, camera.height]) {
            Ok(inverse) => Some(Projection::Distorted(calibration, distortion, inverse)),
            Err(fold) => {
                let key = distortion.culprit(fold.radius).map(|key| format!("/{key}"));
                let pointer = format!("/camera/distortion{}", key.unwrap_or_default());
                let (message, help) = fold_message(&distortion, &fold);
                self.problems.error(&pointer, message, Some(help.into()));
                None
            }
        }
    }

    /// Refuses an override of the frame's size alone: intrinsics belong to one size.
    fn size_of_intrinsics(&mut self) {
        let set = |key: &str| {
            let pointer = format!("/camera/{key}");
            let node = self.document.get(&pointer);
            // Only an override of exactly this key counts: one of the whole camera has its own
            // intrinsics.
            node.is_some_and(|node| matches!(&node.place, JsonPlace::Set(at) if **at == *pointer))
        };
        if set("fx") {
            return;
        }
        for key in ["width", "height"].into_iter().filter(|key| set(key)) {
            let message = format!(
                "found another {key} for a camera of type `intrinsics`, expected the one of the calibration"
            );
            let help = "scale fx, fy, cx and cy, too: --set /camera/fx=...; or use --crop";
            self.problems.error(&format!("/camera/{key}"), message, Some(help.into()));
        }
    }

    /// Checks the matrix of the pose.
    pub(super) fn matrix_pose(&mut self, camera: &Intrinsics) -> Option<CameraPose> {
        let (key, matrix) = match (camera.world_to_camera, camera.camera_to_world) {
            (Some(matrix), None) => ("world_to_camera", matrix),
            (None, Some(matrix)) => ("camera_to_world", matrix),
            (None, None) => {
                let message =
                    "missing key `world_to_camera` or `camera_to_world`, expected exactly one";
                self.problems.error("/camera", message, None);
                return None;
            }
            (Some(_), Some(_)) => {
                let message =
                    "found both `world_to_camera` and `camera_to_world`, expected exactly one";
                let help = Some("remove one of them".into());
                self.problems.error("/camera/camera_to_world", message, help);
                return None;
            }
        };
        match rigid(&matrix) {
            Ok((rotation, translation)) => {
                let (to_world, position) = match key {
                    "camera_to_world" => (rotation, translation),
                    _ => (rotation.transpose(), -(rotation.transpose() * translation)),
                };
                let flip = if camera.axes == Axes::OpenGl { -1.0 } else { 1.0 };
                let (up, lookat) = (to_world.y_axis * -flip, to_world.z_axis * flip);
                Some(CameraPose { position, lookat, up })
            }
            Err((message, help)) => {
                let help = help.map(String::from);
                self.problems.error(&format!("/camera/{key}"), message, help);
                None
            }
        }
    }
}

/// Returns the rotation nearest to the upper left 3 x 3 part of a matrix, and the last column.
fn rigid(written: &Matrix) -> Result<(DMat3, DVec3), Refusal> {
    let (matrix, translation) = split(written)?;
    let product = matrix * matrix.transpose() - DMat3::IDENTITY;
    let deviation = product.to_cols_array().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    // `max` skips NaN. Only an overflow makes one, and then a sum of squares is infinite, too.
    if deviation > MAX_DEVIATION {
        let lengths = [0, 1, 2].map(|row| matrix.row(row).length());
        let [a, b, c] = lengths;
        let message = format!(
            "found a matrix that is no rotation: R R^T differs from 1 by {deviation:.1e}, its rows have the lengths {a:.6}, {b:.6} and {c:.6}, expected at most {MAX_DEVIATION:e}"
        );
        let scaled = lengths.iter().all(|x| (x / a - 1.0).abs() < MAX_DEVIATION);
        let help = "the matrix scales: divide the rotation by that length";
        return Err((message, (scaled && (a - 1.0).abs() > MAX_DEVIATION).then_some(help)));
    }
    if matrix.determinant() < 0.0 {
        let message = "found a matrix that mirrors (determinant -1), expected a rotation";
        let help = "`axes` turns two axes at once: a matrix with one axis turned is left-handed";
        return Err((message.into(), Some(help)));
    }
    // Newton's iteration for the polar decomposition. A quarter turn keeps its bits.
    let mut rotation = matrix;
    for _ in 0..4 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    Ok((rotation, translation))
}

/// Converts a distortion to the one form of both models: numerator and denominator.
fn distortion(written: &DistortionDescription) -> Distortion {
    match *written {
        DistortionDescription::BrownConrady(d) => Distortion {
            model: Model::BrownConrady,
            numerator: [d.k1, d.k2, d.k3, 0.0],
            denominator: [d.k4, d.k5, d.k6],
            tangential: [d.p1, d.p2],
        },
        DistortionDescription::Fisheye(d) => Distortion {
            model: Model::Fisheye,
            numerator: [d.k1, d.k2, d.k3, d.k4],
            denominator: [0.0; 3],
            tangential: [0.0; 2],
        },
    }
}

/// Returns message and help of a distortion that folds.
fn fold_message(distortion: &Distortion, fold: &Fold) -> (String, &'static str) {
    let [x, y] = fold.raster.map(f64::floor);
    if distortion.model == Model::Fisheye && fold.radius > PI * (1.0 - 1e-6) {
        let message = format!(
            "found a frame that reaches beyond theta = 180 degrees, at pixel ({x}, {y}): pixels beyond have no direction"
        );
        return (message, "give a smaller `width` and `height` with `cx` and `cy` to match");
    }
    let radius = match distortion.model {
        Model::BrownConrady => format!("r = {:.4}", fold.radius),
        Model::Fisheye => format!("theta = {:.2} degrees", fold.radius.to_degrees()),
    };
    let message = format!(
        "found a distortion that folds inside the frame, at {radius}, pixel ({x}, {y}): pixels beyond have no direction, expected a fold outside"
    );
    let help = "calibrate with fewer coefficients, or give a smaller `width` and `height` with `cx` and `cy` to match";
    (message, help)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, EulerRot};

    use super::{Matrix, rigid};

    /// With the nearest rotation Q, Q^T M is symmetric and positive (polar decomposition).
    #[test]
    fn rounded_matrices_give_the_nearest_rotation() {
        for k in 0..50 {
            let angles = [0.7, 1.1, 2.3].map(|step| f64::from(k) * step);
            let [x, y, z] = angles;
            let exact = DMat3::from_euler(EulerRot::XYZ, x, y, z);
            let digits = DMat3::from_cols_array(
                &exact.to_cols_array().map(|value| (value * 1e5).round() / 1e5),
            );
            let row = |r: usize| [digits.row(r).x, digits.row(r).y, digits.row(r).z, 5.0];
            let written = Matrix([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]);
            let (rotation, _) = rigid(&written).unwrap();
            let largest =
                |m: DMat3| m.to_cols_array().iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let product = rotation * rotation.transpose();
            assert!(largest(product - DMat3::IDENTITY) < 1e-15, "{k}: {product}");
            let stretch = rotation.transpose() * digits;
            assert!(largest(stretch - stretch.transpose()) < 1e-15, "{k}: {stretch}");
            assert!(largest(stretch - DMat3::IDENTITY) < 2e-5, "{k}: {stretch}");
        }
    }
}
