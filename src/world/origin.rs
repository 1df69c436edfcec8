//! Chooses the origin of the scene's coordinates, and computes the precision near the camera.
//!
//! Rays and corners are f32. A coordinate is rounded by up to 2^-24 of its distance from the
//! origin, so the origin belongs where the picture needs precision. The middle of the scene's box
//! serves all cameras equally. It is the origin unless the box is large compared with the camera's
//! distance from the nearest shape. Otherwise the camera is the origin. Every f32 coordinate is
//! then rounded by at most 2^-24 of its own distance from the camera: far less than a pixel. The
//! numbers of the scene file are f64. If their rounding is visible, there is a warning.

use glam::DVec3;

use super::bounds::Bounds;
use crate::camera::pixel_size;
use crate::error::Problem;
use crate::scene::{CheckedCamera, Projection, ShapeKind};

/// Largest ratio of half of the box's longest side to the camera's distance from the nearest shape,
/// for an origin in the middle of the box. Each coordinate of a point on a shape is then rounded by
/// at most 2^-16 of the point's distance from the camera. This need not hold inside a shape's box,
/// where the distance is an estimate ([`INSIDE`]).
const MAX_RATIO: f64 = 256.0;

/// If the camera is inside a shape's box, its distance from the shape is taken as this fraction of
/// the box's longest side.
const INSIDE: f64 = 1.0 / 256.0;

/// A camera stands on a shape if it is nearer than this fraction of the longest side of the shape's
/// box.
const STANDING: f64 = 1e-9;

/// Rounding above this fraction of a pixel causes a warning.
const MAX_PIXELS: f64 = 1.0 / 16.0;

/// Half an ulp of 1 in single and in double precision.
const SINGLE: f64 = 1.0 / (1u64 << 24) as f64;
const DOUBLE: f64 = 1.0 / (1u64 << 53) as f64;

/// The origin of coordinates, and the rounding of positions near the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// World position of the origin.
    pub position: DVec3,
    /// True if the origin is the camera's position, false if it is the middle of the scene's box.
    pub at_camera: bool,
    /// Longest side of the scene's bounding box, in world units.
    pub extent: f64,
    /// Distance of the camera from the nearest shape that it does not stand on, in world units:
    /// exact for spheres, an estimate by the bounding box for others. Infinite without such a
    /// shape.
    pub nearest: f64,
    /// Largest rounding of a coordinate at that distance, in world units.
    pub rounding: f64,
    /// The same rounding seen from the camera, in pixels.
    pub pixels: f64,
    /// True for a camera of parallel rays, which sees the same from any place along them.
    pub parallel: bool,
}

/// What a camera sees of a world whose origin another camera may have chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The origin of a render of this camera alone.
    pub own: Origin,
    /// The world's origin, with the rounding that this camera sees.
    pub here: Origin,
}

impl View {
    /// Returns true if a render of this camera alone has the world's origin.
    pub fn is_own(&self) -> bool {
        self.own.position == self.here.position
    }
}

impl Origin {
    /// Chooses the origin for a scene with these shapes and boxes.
    pub fn choose(camera: &CheckedCamera, shapes: &[(&ShapeKind, Bounds)]) -> Self {
        let all = shapes.iter().fold(Bounds::EMPTY, |all, (_, bounds)| all.union(*bounds));
        let distances = shapes.iter().map(|(shape, b)| distance(camera.position, shape, *b));
        let least = distances.fold(f64::INFINITY, f64::min);
        let extent = all.longest_side().max(0.0);
        let at_camera = least.is_finite() && extent / 2.0 > MAX_RATIO * least;
        let position = if at_camera { camera.position } else { all.origin() };
        let nearest = f64::INFINITY;
        let (rounding, pixels, parallel) = (0.0, 0.0, false);
        let origin = Self { position, at_camera, extent, nearest, rounding, pixels, parallel };
        origin.seen_by(camera, shapes)
    }

    /// Returns the same origin with the rounding that a camera of the same scene sees.
    pub fn seen_by(self, camera: &CheckedCamera, shapes: &[(&ShapeKind, Bounds)]) -> Self {
        let (mut largest, mut nearest) = (0.0f64, f64::INFINITY);
        for (shape, bounds) in shapes {
            let distance = distance(camera.position, shape, *bounds);
            if distance > STANDING * bounds.longest_side() {
                nearest = nearest.min(distance);
            }
            if let ShapeKind::Sphere { center, radius, .. } = shape {
                largest = largest.max((*center - camera.position).length() + radius);
            }
        }
        let parallel = matches!(camera.projection, Projection::Orthographic { .. });
        if !nearest.is_finite() {
            return Self { nearest, rounding: 0.0, pixels: 0.0, parallel, ..self };
        }
        let away = (camera.position - self.position).abs().max_element();
        // The scene's numbers are doubles: camera and shape are each off by half an ulp.
        let written = 2.0 * DOUBLE * camera.position.abs().max_element();
        let rounding = SINGLE * (away + nearest) + 4.0 * DOUBLE * largest + written;
        let pixel = pixel_size(camera);
        let pixels = rounding / pixel / if parallel { 1.0 } else { nearest };
        Self { nearest, rounding, pixels, parallel, ..self }
    }

    /// Returns a warning if the rounding is visible.
    pub fn warning(&self) -> Option<Problem> {
        let Self { extent, nearest, rounding, pixels, .. } = *self;
        let share = if pixels < 1e4 { format!("{pixels:.2}") } else { format!("{pixels:.1e}") };
        let message = format!(
            "the scene is {extent:.1e} wide and its nearest shape {nearest:.1e} from the camera: \
             there, positions are rounded to {rounding:.1e}, {share} of a pixel"
        );
        let cures =
            "leave out what is so far away, choose smaller spheres, or move all closer to 0";
        let nearer = "move the camera's `position` along its rays to the shapes, or ";
        let help = format!("{}{cures}", if self.parallel { nearer } else { "" });
        (pixels > MAX_PIXELS).then(|| Problem::new("scene", message).help(help))
    }
}

/// Returns the distance from a point to a shape: exact for spheres, a lower bound for points
/// outside the box of another shape. For points inside it, an estimate by [`INSIDE`].
fn distance(point: DVec3, shape: &ShapeKind, bounds: Bounds) -> f64 {
    if let ShapeKind::Sphere { center, radius, .. } = shape {
        return ((*center - point).length() - radius).abs();
    }
    let outside = (bounds.min - point).max(point - bounds.max).max(DVec3::ZERO).length();
    if outside > 0.0 { outside } else { INSIDE * bounds.longest_side() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(position: DVec3) -> CheckedCamera {
        let (lookat, up) = (DVec3::NEG_Z, DVec3::Y);
        let projection = Projection::Perspective { fov_deg: 60.0, lens: None };
        CheckedCamera { width: 160, height: 120, position, lookat, up, projection }
    }

    fn sphere(radius: f64) -> ShapeKind {
        ShapeKind::Sphere { center: DVec3::new(0.0, -radius, 0.0), radius, pole: 2 }
    }

    fn choose(position: DVec3, shapes: &[ShapeKind]) -> Origin {
        Origin::choose(&camera(position), &boxed(shapes))
    }

    fn boxed(shapes: &[ShapeKind]) -> Vec<(&ShapeKind, Bounds)> {
        shapes.iter().map(|shape| (shape, Bounds::from_shape(shape))).collect()
    }

    #[test]
    fn ordinary_scenes_have_their_middle_as_origin() {
        let origin = choose(DVec3::new(0.0, 1.0, 3.0), &[sphere(1.0)]);
        assert_eq!(origin.position, DVec3::new(0.0, -1.0, 0.0));
        assert!(!origin.at_camera && origin.warning().is_none());
    }

    #[test]
    fn on_a_planet_the_camera_is_the_origin() {
        for radius in [1e4, 6.371e6, 1e9] {
            let eye = DVec3::new(0.5, 1.7, 4.0);
            let origin = choose(eye, &[sphere(radius), sphere(1.0)]);
            assert!(origin.at_camera && origin.position == eye);
            assert!(origin.pixels < 1e-3, "{origin:?}");
        }
    }

    #[test]
    fn a_scene_too_large_for_doubles_causes_a_warning() {
        let origin = choose(DVec3::new(0.5, 1.7, 4.0), &[sphere(1e14), sphere(1.0)]);
        let warning = origin.warning().unwrap().to_string();
        assert!(warning.contains("of a pixel"), "{warning}");
        let huge = Origin { pixels: 7e300, ..origin }.warning().unwrap().to_string();
        assert!(huge.contains(", 7.0e300 of a pixel"), "{huge}");
    }

    #[test]
    fn a_scene_too_far_from_zero_for_doubles_causes_a_warning() {
        for (far, warned) in [(1e6, false), (1e12, false), (1e14, true), (1e16, true)] {
            let center = DVec3::new(far, 0.0, 0.0);
            let ball = ShapeKind::Sphere { center, radius: 1.0, pole: 2 };
            let origin = choose(center + DVec3::new(0.0, 0.0, 5.0), &[ball]);
            assert_eq!(origin.warning().is_some(), warned, "{far:e}: {origin:?}");
        }
    }

    #[test]
    fn parallel_rays_can_start_nearer() {
        let projection = Projection::Orthographic { width: 1.0 };
        let far = CheckedCamera { projection, ..camera(DVec3::new(0.0, 0.0, 1e6)) };
        let ball = ShapeKind::Sphere { center: DVec3::ZERO, radius: 1.0, pole: 2 };
        let warning = |camera: &CheckedCamera| {
            Origin::choose(camera, &boxed(std::slice::from_ref(&ball))).warning()
        };
        let told = warning(&far).unwrap().to_string();
        assert!(told.contains("move the camera's `position` along its rays"), "{told}");
        let near = CheckedCamera { position: DVec3::new(0.0, 0.0, 2.0), ..far.clone() };
        assert_eq!(warning(&near), None);
    }

    #[test]
    fn another_camera_of_the_scene_sees_its_own_rounding() {
        let shapes = [sphere(1e9), sphere(1.0)];
        let (eye, away) = (DVec3::new(0.5, 1.7, 4.0), DVec3::new(1e5, 1.7, 4.0));
        let origin = choose(away, &shapes);
        assert!(origin.at_camera && origin.warning().is_none(), "{origin:?}");
        let seen = origin.seen_by(&camera(eye), &boxed(&shapes));
        assert!(seen.position == away && seen.warning().is_some(), "{seen:?}");
    }

    #[test]
    fn a_camera_inside_a_box_counts_as_near() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::new(0.0, 1.0, 1.0)];
        let plane = ShapeKind::Plane { corners };
        let origin = choose(DVec3::splat(0.5), std::slice::from_ref(&plane));
        assert!(!origin.at_camera, "a room is seen from within");
        let far = ShapeKind::Sphere { center: DVec3::X * 1e4, radius: 1.0, pole: 2 };
        assert!(choose(DVec3::splat(0.5), &[plane, far]).at_camera);
    }
}
