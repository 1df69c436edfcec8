//! Cameras whose rays are not those of a pinhole: distorted, orthographic, panoramic.
//!
//! Their code is not inlined into the kernels of pinholes. No frustum of such a camera is culled:
//! its rays have no common origin, or pixels in a line are not directions in a plane.

use std::sync::Arc;

use glam::{DVec2, DVec3, Vec3};

use super::axes::{sees_behind, unit};
use crate::calibration::Inverse;
use crate::ray::{LANES, Rays};
use crate::scene::{self, Projection};

/// The rays of a camera that is neither a pinhole nor a thin lens.
#[derive(Debug)]
pub struct GeneralProjection {
    /// Position relative to the scene's origin.
    position: DVec3,
    /// Unit axes: X right, Y up, Z forward.
    axes: [DVec3; 3],
    kind: Kind,
    /// Whether the camera can see what lies beside it and behind it.
    pub(super) sees_behind: bool,
}

#[derive(Debug)]
enum Kind {
    /// Directions from one position, through a lens.
    Distorted(Arc<Inverse>),
    /// One direction; pixels are offsets of the origin.
    Orthographic {
        /// Offset of the frame's top left corner in units of X and Y.
        corner: [f64; 2],
        /// Side of a pixel.
        pixel: f64,
    },
    /// Angles from one position.
    Panorama {
        /// Longitude and latitude of the frame's top left corner in radians.
        corner: [f64; 2],
        /// Angles of a pixel to the right and down in radians.
        pixel: [f64; 2],
    },
}

impl GeneralProjection {
    /// The rays of a checked camera at `position`.
    pub(super) fn new(camera: &scene::CheckedCamera, position: DVec3, axes: [DVec3; 3]) -> Self {
        let [columns, rows] = [camera.width, camera.height].map(f64::from);
        let kind = match &camera.projection {
            Projection::Distorted(_, _, inverse) => Kind::Distorted(Arc::clone(inverse)),
            Projection::Panorama { longitude_deg, latitude_deg } => {
                let [left, right] = longitude_deg.map(f64::to_radians);
                let [low, high] = latitude_deg.map(f64::to_radians);
                let pixel = [(right - left) / columns, (low - high) / rows];
                Kind::Panorama { corner: [left, high], pixel }
            }
            Projection::Orthographic { width } => {
                let pixel = width / columns;
                Kind::Orthographic { corner: [-0.5 * width, 0.5 * pixel * rows], pixel }
            }
            // Cameras with linear rays do not come here.
            Projection::Calibrated(_) | Projection::Perspective { .. } => {
                Kind::Orthographic { corner: [0.0; 2], pixel: 0.0 }
            }
        };
        Self { position, axes, kind, sees_behind: sees_behind(camera) }
    }

    /// Sets origin and direction of all lanes of a packet. `x` and `y` are raster positions.
    #[inline(never)]
    pub fn aim(&self, x: &[f32; LANES], y: &[f32; LANES], rays: &mut Rays) {
        for i in 0..LANES {
            let (origin, direction) = self.ray(x[i], y[i]);
            for axis in 0..3 {
                rays.org[axis][i] = origin[axis];
                rays.dir[axis][i] = direction[axis];
            }
        }
    }

    /// Origin and unit direction of the ray through a raster position.
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        let (origin, direction) = self.exact_ray([x, y].map(f64::from));
        let direction = unit(direction);
        // Only pixels beyond the frame and its overscan, which no picture keeps, may have none.
        let direction = if direction.is_finite() { direction } else { self.axes[2].as_vec3() };
        (origin.as_vec3(), direction)
    }

    /// Origin, relative to the scene's origin, and direction, of any length, in f64.
    pub fn exact_ray(&self, [u, v]: [f64; 2]) -> (DVec3, DVec3) {
        let [x, y, z] = self.axes;
        match &self.kind {
            Kind::Distorted(inverse) => {
                let [right, down, forward] = inverse.direction([u, v]);
                (self.position, x * right - y * down + z * forward)
            }
            Kind::Orthographic { corner: [left, top], pixel } => {
                (self.position + x * (left + u * pixel) + y * (top - v * pixel), z)
            }
            Kind::Panorama { corner, pixel } => {
                let (sin, cos) = (corner[0] + u * pixel[0]).sin_cos();
                let (up, level) = (corner[1] + v * pixel[1]).sin_cos();
                (self.position, x * (sin * level) + y * up + z * (cos * level))
            }
        }
    }

    /// Changes of origin and unit direction from a raster position to one a pixel to the right and
    /// to one a pixel below. Zero where the camera has no rays.
    #[inline(never)]
    pub fn changes(&self, at: [f64; 2]) -> [[DVec3; 2]; 2] {
        let ray = |at: DVec2| {
            let (origin, direction) = self.exact_ray(at.to_array());
            [origin, direction.normalize()]
        };
        let at = DVec2::from(at);
        let [origin, direction] = ray(at);
        [DVec2::X, DVec2::Y].map(|step| {
            // Beyond the last pixel of the frame and its overscan there may be no ray.
            let mut changes = [1.0, -1.0].into_iter().map(|side| {
                let [o, d] = ray(at + step * side);
                [(o - origin) * side, (d - direction) * side]
            });
            changes.find(|[o, d]| o.is_finite() && d.is_finite()).unwrap_or_default()
        })
    }
}
