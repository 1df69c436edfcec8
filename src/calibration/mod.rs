//! Calibrated cameras: from pixels to directions of the camera, without a pose.
//!
//! Formulas: the pages "Camera Calibration and 3D Reconstruction" and "Fisheye camera model" of
//! OpenCV's documentation.

mod distortion;
mod intrinsics;
mod inverse;
mod shared;

pub use self::distortion::{Distortion, Model};
pub use self::intrinsics::Calibration;
pub use self::inverse::{Fold, Inverse};
pub use self::shared::shared_inverse;
