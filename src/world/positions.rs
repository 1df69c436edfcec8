//! Warns of a layer of positions that is too coarse to measure with: its f32 numbers are
//! coordinates of the world, which may be far from 0.

use glam::DVec3;

use super::bounds::Bounds;
use super::resolution::ulp;
use crate::camera::pixel_size;
use crate::error::Problem;
use crate::scene::{CheckedCamera, Projection};

/// Largest step between neighbouring positions, as a share of a pixel's width, without a warning.
const MAX_SHARE: f64 = 0.1;

/// Returns a warning if the layer of positions is coarse beside a pixel in the middle of the frame
/// of `camera`, at the distance of the middle of the scene's `bounds`. A camera near the middle is
/// inside of the scene, and sees surfaces at about half of its shortest side.
pub(super) fn warning(camera: &CheckedCamera, bounds: Bounds) -> Option<Problem> {
    let middle = (bounds.min + bounds.max) / 2.0;
    let step = ulp(middle.abs().max_element());
    let sides = ((bounds.max - bounds.min) / 2.0).to_array().into_iter();
    let inside = sides.filter(|&side| side > 0.0).reduce(f64::min).unwrap_or(0.0);
    let distance = match camera.projection {
        Projection::Orthographic { .. } => 1.0,
        _ => middle.distance(camera.position).max(inside),
    };
    let pixel = pixel_size(camera) * distance;
    let message = format!(
        "the layer `P` has steps of {step:.1e} so far from 0, and a pixel in the middle of the scene \
         is {pixel:.1e} wide"
    );
    // Adding 0 turns -0 into 0.
    let [x, y, z] = (DVec3::ZERO - middle).round().to_array().map(|c| c + 0.0);
    let help = format!(
        "add [{x}, {y}, {z}] to the `center` of meshes and to all other positions, or compute \
         positions from `Z` and the camera of `lightpath:camera` in the EXR"
    );
    let is_coarse = middle.is_finite() && step > MAX_SHARE * pixel;
    is_coarse.then(|| Problem::new("scene", message).help(help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_positions_are_those_far_from_0() {
        let offset = DVec3::new(412_345.678, 5_123_456.789, 0.0);
        let wide = Projection::Orthographic { width: 8.0 };
        let narrow = Projection::Perspective { fov_deg: 60.0, lens: None };
        for projection in [wide, narrow] {
            for (at, warned) in [(DVec3::ZERO, false), (offset / 1e3, false), (offset, true)] {
                let camera = CheckedCamera {
                    width: 400,
                    height: 400,
                    position: at + DVec3::new(0.0, 0.0, 10.0),
                    lookat: DVec3::NEG_Z,
                    up: DVec3::Y,
                    projection: projection.clone(),
                };
                let bounds = Bounds { min: at - DVec3::ONE, max: at + DVec3::ONE };
                let warning = warning(&camera, bounds);
                assert_eq!(warning.is_some(), warned, "{at}: {warning:?}");
                if let Some(warning) = warning.map(|warning| warning.to_string()) {
                    assert!(warning.contains("steps of 5.0e-1"), "{warning}");
                    assert!(warning.contains("[-412346, -5123457, 0]"), "{warning}");
                }
            }
        }
        // A camera in the middle of a room, at home and in the coordinates of a survey.
        for (at, warned) in [(DVec3::new(2.0, 1.5, 3.0), false), (offset, true)] {
            let room = DVec3::new(5.0, 3.0, 5.0);
            let camera = CheckedCamera {
                width: 48,
                height: 48,
                position: at,
                lookat: at - DVec3::Z,
                up: DVec3::Y,
                projection: Projection::Perspective { fov_deg: 30.0, lens: None },
            };
            let warning = warning(&camera, Bounds { min: at - room, max: at + room });
            assert_eq!(warning.is_some(), warned, "{at}: {warning:?}");
        }
        let empty = Bounds::EMPTY;
        let camera = CheckedCamera {
            width: 4,
            height: 4,
            position: DVec3::ZERO,
            lookat: DVec3::NEG_Z,
            up: DVec3::Y,
            projection: Projection::Orthographic { width: 8.0 },
        };
        assert_eq!(warning(&camera, empty), None);
    }
}
