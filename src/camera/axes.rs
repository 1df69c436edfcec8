//! The axes of a camera, and unit directions.

use glam::{DVec3, Vec3};

use crate::calibration::Model;
use crate::scene::{self, Projection};

/// The camera's unit axes: X right, Y up, Z forward.
pub fn axes(camera: &scene::CheckedCamera) -> [DVec3; 3] {
    let z = camera.lookat.normalize();
    let x = z.cross(camera.up).normalize();
    [x, x.cross(z), z]
}

/// Whether the camera can see what lies beside it and behind it. The layer `Z` then holds the
/// distance, not the depth along the axis.
pub fn sees_behind(camera: &scene::CheckedCamera) -> bool {
    match &camera.projection {
        Projection::Distorted(_, distortion, _) => distortion.model == Model::Fisheye,
        Projection::Panorama { .. } => true,
        _ => false,
    }
}

/// Normalises a direction and rounds it once.
#[inline(always)]
pub fn unit(v: DVec3) -> Vec3 {
    (v * (1.0 / v.dot(v).sqrt())).as_vec3()
}
