//! The camera: rays from pixels and samples, exactly as docs/guide/cameras.md defines them.

mod axes;
mod general_projection;
mod header;

use std::sync::Arc;

use glam::{DVec3, Vec3};

use self::axes::unit;
use crate::calibration::Fold;
use crate::sampler::disk;
use crate::scene::{self, Projection};

pub use self::axes::{axes, sees_behind};
pub use self::general_projection::GeneralProjection;
pub use self::header::{
    Screen, described, pixel_size, screen, sides, world_to_camera, world_to_ndc,
};

/// A camera relative to the scene's origin. Computed in f64 and rounded once into each ray, so
/// directions are right to half an ulp plus 2^-45.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Position relative to the scene's origin.
    position: DVec3,
    /// Direction to the top left corner of the frame, not normalised.
    corner: DVec3,
    /// Change of that direction per pixel to the right.
    right: DVec3,
    /// Change of that direction per pixel down.
    down: DVec3,
    /// Unit direction of view.
    forward: DVec3,
    lens: Option<Lens>,
    /// Rays of a camera that is neither a pinhole nor a thin lens. They take the place of `corner`,
    /// `right` and `down`.
    general_projection: Option<Arc<GeneralProjection>>,
}

#[derive(Debug, Clone, Copy)]
struct Lens {
    /// Half the aperture, along the camera's X axis.
    x: DVec3,
    /// Half the aperture, along the camera's Y axis.
    y: DVec3,
    focal_distance: f64,
}

/// Checks that a camera has a ray for every pixel up to `overscan` pixels beyond its frame.
///
/// # Errors
/// The [`Fold`] of the lens distortion, where two directions map to one pixel.
pub fn check_overscan(camera: &scene::CheckedCamera, overscan: u32) -> Result<(), Fold> {
    match &camera.projection {
        Projection::Distorted(_, _, inverse) => inverse.check_overscan(overscan),
        _ => Ok(()),
    }
}

/// Limit of the frame at distance 1: of its half sides ([`Camera::new`]) or of the coordinates of
/// its corners ([`Camera::linear`]). Beyond the limit, all directions are divided by `FARTHEST`, a
/// power of two.
const FARTHEST: f64 = (1u64 << 30) as f64;

impl Camera {
    /// The camera relative to `origin`, the world position of the scene's origin.
    pub fn new(camera: &scene::CheckedCamera, origin: DVec3) -> Self {
        let [x, y, z] = axes(camera);
        let position = camera.position - origin;
        let (fov_deg, lens) = match camera.projection {
            Projection::Perspective { fov_deg, lens } => (fov_deg, lens),
            Projection::Calibrated(calibration) => {
                let [right, down] = [calibration.focal[0], calibration.focal[1]];
                let right = x / right;
                let down = (-y - right * calibration.skew) / down;
                let [u, v] = calibration.principal;
                let corner = z - right * u - down * v;
                return Self::linear(position, z, [corner, right, down], camera);
            }
            _ => {
                let general_projection =
                    Some(Arc::new(GeneralProjection::new(camera, position, [x, y, z])));
                let none = DVec3::ZERO;
                let (corner, right, down) = (z, none, none);
                return Self {
                    position,
                    corner,
                    right,
                    down,
                    forward: z,
                    lens: None,
                    general_projection,
                };
            }
        };
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let tan = (fov_deg.to_radians() / 2.0).tan();
        let half_width = width / height * tan;
        // An aperture of 0 is a pinhole, bit for bit.
        let lens = lens.filter(|lens| lens.aperture > 0.0).map(|lens| Lens {
            x: x * (lens.aperture / 2.0),
            y: y * (lens.aperture / 2.0),
            focal_distance: lens.focal_distance,
        });
        // The squared length in `unit_of_frame` must fit into f32.
        let far = half_width.max(tan) > FARTHEST;
        let scale = if far { 1.0 / FARTHEST } else { 1.0 };
        let lens = lens.map(|lens| Lens { focal_distance: lens.focal_distance / scale, ..lens });
        Self {
            position,
            corner: (z - x * half_width + y * tan) * scale,
            right: x * (2.0 * half_width / width) * scale,
            down: y * (-2.0 * tan / height) * scale,
            forward: z,
            lens,
            general_projection: None,
        }
    }

    /// A pinhole by the direction to its corner and the steps per pixel.
    fn linear(
        position: DVec3,
        forward: DVec3,
        [corner, right, down]: [DVec3; 3],
        camera: &scene::CheckedCamera,
    ) -> Self {
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let ends = [corner, corner + right * width, corner + down * height];
        let ends = ends.into_iter().chain([ends[1] + down * height]);
        let far = ends.map(|end| end.abs().max_element()).fold(0.0, f64::max) > FARTHEST;
        let scale = if far { 1.0 / FARTHEST } else { 1.0 };
        let [corner, right, down] = [corner, right, down].map(|v| v * scale);
        Self { position, corner, right, down, forward, lens: None, general_projection: None }
    }

    /// Depth of a point: its distance along the camera's axis, not along the ray. Negative behind
    /// the camera. The point is relative to the scene's origin.
    #[inline(always)]
    pub fn depth(&self, point: DVec3) -> f64 {
        (point - self.position).dot(self.forward)
    }

    /// Distance of a point from the camera's position. The point is relative to the scene's origin.
    #[inline(always)]
    pub fn distance(&self, point: DVec3) -> f64 {
        (point - self.position).length()
    }

    /// Whether the camera sees what lies beside and behind it: see the function [`sees_behind`].
    pub fn sees_behind(&self) -> bool {
        self.general_projection.as_ref().is_some_and(|projection| projection.sees_behind)
    }

    /// Changes per pixel, to the right and down, of the point that a ray has in the plane at
    /// distance 1 along the unit direction of view, and this direction. For cameras without a
    /// general projection; through a lens, of the ray from one point of the lens.
    pub fn steps(&self) -> ([DVec3; 2], DVec3) {
        let distance = self.corner.dot(self.forward);
        ([self.right / distance, self.down / distance], self.forward)
    }

    /// Whether rays need lens samples, that is, whether the camera has a lens.
    pub fn has_lens(&self) -> bool {
        self.lens.is_some()
    }

    /// The rays of a camera that is neither a pinhole nor a thin lens.
    #[inline(always)]
    pub fn general_projection(&self) -> Option<&GeneralProjection> {
        self.general_projection.as_deref()
    }

    /// Origin and unit direction of the ray through raster position (x, y), in pixels from the
    /// frame's top left corner. `lens` are lens coordinates in [0, 1)^2; a pinhole ignores them.
    #[inline(always)]
    pub fn ray(&self, x: f32, y: f32, lens: [f32; 2]) -> (Vec3, Vec3) {
        match (&self.lens, &self.general_projection) {
            (None, None) => self.pinhole_ray(x, y),
            (None, Some(projection)) => projection.ray(x, y),
            (Some(l), _) => {
                let direction = self.towards(x, y);
                let [lx, ly] = disk(lens);
                let offset = l.x * f64::from(lx) + l.y * f64::from(ly);
                let origin = (self.position + offset).as_vec3();
                (origin, unit(direction * l.focal_distance - offset))
            }
        }
    }
}

impl Camera {
    /// [`Camera::ray`] for a camera without a lens and without a general projection.
    #[inline(always)]
    pub fn pinhole_ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        (self.position.as_vec3(), unit_of_frame(self.towards(x, y)))
    }

    #[inline(always)]
    fn towards(&self, x: f32, y: f32) -> DVec3 {
        self.corner + self.right * f64::from(x) + self.down * f64::from(y)
    }
}

/// [`unit`] for a direction to a point of the frame: a root in f32 and one Newton step. Its error
/// is at most 2^-45 of the length, and it avoids f64's root and division.
#[inline(always)]
fn unit_of_frame(v: DVec3) -> Vec3 {
    let square = v.dot(v);
    let inverse = f64::from(1.0 / (square as f32).sqrt());
    (v * (inverse * (1.5 - 0.5 * square * inverse * inverse))).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(lens: Option<scene::CheckedLens>) -> scene::CheckedCamera {
        scene::CheckedCamera {
            width: 400,
            height: 200,
            projection: Projection::Perspective { fov_deg: 90.0, lens },
            position: DVec3::new(1.0, 2.0, 3.0),
            lookat: DVec3::new(0.0, 0.0, 5.0),
            up: DVec3::new(0.0, 3.0, 1.0),
        }
    }

    fn with_fov(fov_deg: f64, lens: Option<scene::CheckedLens>) -> scene::CheckedCamera {
        let projection = Projection::Perspective { fov_deg, lens };
        scene::CheckedCamera { projection, ..camera(None) }
    }

    #[test]
    fn corners_and_centre() {
        let c = Camera::new(&camera(None), DVec3::ZERO);
        // Z = +z and up = +y give X = Z x up = -x.
        let ray = |x, y| c.ray(x, y, [0.0; 2]).1;
        assert!((ray(200.0, 100.0) - Vec3::Z).length() < 1e-7);
        let expect = Vec3::new(2.0, 1.0, 1.0).normalize();
        assert!((ray(0.0, 0.0) - expect).length() < 1e-6);
        let expect = Vec3::new(-2.0, -1.0, 1.0).normalize();
        assert!((ray(400.0, 200.0) - expect).length() < 1e-6);
    }

    #[test]
    fn directions_of_a_telescope_are_rounded_once() {
        let spec = with_fov(1e-3, None);
        let spec = scene::CheckedCamera { lookat: DVec3::new(0.3, -0.8, 0.5), ..spec };
        let c = Camera::new(&spec, DVec3::ZERO);
        let [x, y, z] = axes(&spec);
        let tan = (0.5e-3f64).to_radians().tan();
        for (i, j) in [(0, 0), (1, 0), (399, 199), (17, 180), (200, 100)] {
            let (sx, sy) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
            let (px, py) = ((2.0 * sx / 400.0 - 1.0) * 2.0 * tan, (1.0 - 2.0 * sy / 200.0) * tan);
            let exact = (x * px + y * py + z).normalize();
            let (_, direction) = c.pinhole_ray(i as f32 + 0.5, j as f32 + 0.5);
            for axis in 0..3 {
                let component = direction[axis];
                let half = f64::from(component.abs() * f32::EPSILON) / 2.0;
                let error = (f64::from(component) - exact[axis]).abs();
                assert!(error <= half * 1.0001, "{error:e} of {component} at ({i}, {j})");
            }
        }
    }

    #[test]
    fn directions_in_the_widest_frames_are_rounded_once() {
        for fov_deg in [179.0, 179.999_999_9, 180.0 - 3e-14] {
            let lens = Some(scene::CheckedLens { aperture: 0.5, focal_distance: 4.0 });
            let spec = scene::CheckedCamera { width: 65_536, height: 1, ..with_fov(fov_deg, lens) };
            let c = Camera::new(&spec, DVec3::ZERO);
            let ([x, y, z], tan) = (axes(&spec), (fov_deg / 2.0).to_radians().tan());
            // The last two points lie in the overscan around the frame.
            for (i, j) in [(0.5, 0.5), (32_768.0, 0.5), (32_768.5, 0.25), (-7e4, 0.0), (7e4, 9.0)] {
                let (sx, sy) = (f64::from(i), f64::from(j));
                let to = x * ((2.0 * sx - 65_536.0) * tan) + y * ((1.0 - 2.0 * sy) * tan) + z;
                let error = (c.pinhole_ray(i, j).1.as_dvec3() - to.normalize()).abs();
                assert!(error.max_element() < 3.1e-8, "{error:?} at ({i}, {j}), {fov_deg}");
                let (origin, direction) = c.ray(i, j, [0.5, 0.5]);
                assert_eq!(origin, c.pinhole_ray(i, j).0);
                assert!((direction - c.pinhole_ray(i, j).1).length() < 1e-6, "{fov_deg}");
            }
        }
    }

    #[test]
    fn lens_rays_intersect_in_the_plane_of_focus() {
        let lens = scene::CheckedLens { aperture: 0.5, focal_distance: 4.0 };
        let c = Camera::new(&camera(Some(lens)), DVec3::ZERO);
        let sharp = Camera::new(&camera(None), DVec3::ZERO).ray(50.0, 60.0, [0.0; 2]);
        let focus = sharp.0 + sharp.1 * (4.0 / sharp.1.z);
        for uv in [[0.1, 0.2], [0.9, 0.4], [0.5, 0.99]] {
            let (o, d) = c.ray(50.0, 60.0, uv);
            assert!((o + d * (4.0 / d.z) - focus).length() < 1e-5);
            assert!((o - sharp.0).length() <= 0.25 + 1e-6);
        }
    }

    #[test]
    fn an_aperture_of_zero_is_a_pinhole_bit_for_bit() {
        let lens = scene::CheckedLens { aperture: 0.0, focal_distance: 4.0 };
        let (a, b) =
            (Camera::new(&camera(None), DVec3::ONE), Camera::new(&camera(Some(lens)), DVec3::ONE));
        assert_eq!(a.ray(1.5, 7.5, [0.3, 0.6]), b.ray(1.5, 7.5, [0.3, 0.6]));
    }
}
