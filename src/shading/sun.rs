//! Directions of a sun: light that arrives from a cone of directions, from beyond the scene.

use glam::{DVec3, Vec3};

use super::light_rays::BEYOND;
use super::points::{Lanes, Lanes3, ShadowPoints, lane, set_lane};
use crate::geometry::{Box3, Geometry, TriangleMesh, doubles};
use crate::ray::LANES;
use crate::sampler::disk;

/// Widest half angle of a cone whose shafts are queried, as a tangent: 45 degrees.
const MAX_TANGENT: f32 = 1.0;

/// Distance of the square of [`Cone::corners`] from the points in lengths of the shadow rays, plus
/// the points' own radius.
const BEYOND_SQUARE: f32 = 1.1 * BEYOND;

/// A cone of directions towards a sun, uniform by solid angle.
#[derive(Debug, Clone, Copy)]
pub struct Cone {
    /// Unit direction towards the middle of the sun.
    pub middle: Vec3,
    /// Unit vectors across `middle`, at right angles.
    across: [Vec3; 2],
    /// 1 - cos of half the angular diameter.
    versine: f32,
    /// Tangent of half the angular diameter.
    tangent: f32,
    /// Length of the shadow rays: they end outside of the scene.
    pub reach: f32,
}

impl Cone {
    /// The cone around `middle` with this angular diameter in degrees, in [0, 180).
    pub fn new(middle: DVec3, angle_deg: f64, geometry: &Geometry) -> Self {
        let middle = middle.normalize();
        let (x, y) = middle.any_orthonormal_pair();
        let half = (angle_deg / 2.0).to_radians();
        // Without the cancellation of 1 - cos.
        let versine = 2.0 * (half / 2.0).sin().powi(2);
        Self {
            middle: middle.as_vec3(),
            across: [x.as_vec3(), y.as_vec3()],
            versine: versine as f32,
            tangent: half.tan() as f32,
            reach: reach(geometry) as f32,
        }
    }

    /// Returns true for a sun of size 0, whose light comes from one direction.
    pub fn is_point(&self) -> bool {
        self.tangent == 0.0
    }

    /// Ends of the shadow rays from `from`, for 16 points (s, t) in the unit square.
    #[inline(always)]
    pub fn points(&self, [s, t]: &[Lanes; 2], from: &Lanes3) -> Lanes3 {
        let mut q = [[0.0; LANES]; 3];
        let [across_x, across_y] = self.across;
        for i in 0..LANES {
            let [x, y] = disk([s[i], t[i]]);
            // The height above the base of a cap is uniform (Archimedes); x and y keep their
            // direction.
            let fall = (x * x + y * y) * self.versine;
            let scale = (self.versine * (2.0 - fall)).sqrt();
            let side = across_x * (x * scale) + across_y * (y * scale);
            let direction = self.middle * (1.0 - fall) + side;
            set_lane(&mut q, i, lane(from, i) + direction * self.reach);
        }
        q
    }

    /// Corners of a square beyond the scene. All shadow rays of the active points run in the convex
    /// hull of the points and the square. `None` if the cone is too wide.
    pub fn corners(&self, points: &ShadowPoints) -> Option<[Vec3; 4]> {
        if self.tangent > MAX_TANGENT {
            return None;
        }
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for i in (0..LANES).filter(|&i| points.hit.0[i] != 0) {
            for p in [lane(&points.position, i), lane(&points.origin, i)] {
                (low, high) = (low.min(p), high.max(p));
            }
        }
        if low.x > high.x {
            return None;
        }
        let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
        // All rays end before the square. There, the hull is wider than all of them by more than
        // the rounding: a ray from a point has the distance from the middle that the point has.
        let far = BEYOND_SQUARE * self.reach + radius;
        let half = self.tangent * 1.001 * (far + radius) + 3.0 * radius + 1e-5 * far;
        let [x, y] = self.across.map(|side| side * half);
        let center = center + self.middle * far;
        Some([center - x - y, center + x - y, center - x + y, center + x + y])
    }
}

/// A length above the diagonal of the bounding box of all primitives; 1 if the box is empty or a
/// point.
pub(super) fn reach(geometry: &Geometry) -> f64 {
    let meshes = geometry.meshes.iter().map(TriangleMesh::bounds);
    let meshes = meshes.chain(geometry.instances.iter().map(|instance| instance.bounds));
    let meshes = meshes.map(|[min, max]| Box3 { min: doubles(min), max: doubles(max) });
    let quads = geometry.quads.iter().map(|quad| Box3::of(&quad.map(doubles)));
    let spheres = geometry.spheres.iter().map(|s| Box3::of_sphere(s.center, s.radius));
    let all = Box3::around(meshes.chain(quads).chain(spheres));
    let size = (all.max - all.min).length();
    if size.is_finite() && size > 0.0 { 1.01 * size } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cone(angle_deg: f64) -> Cone {
        let geometry = Geometry::default();
        Cone { reach: 8.0, ..Cone::new(DVec3::new(0.3, 2.0, -1.0), angle_deg, &geometry) }
    }

    #[test]
    fn the_reach_is_that_of_finite_vertices() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let vertices = vec![[3.0, 0.0, 0.0], [0.0, 4.0, 0.0], [nan; 3], [inf, -inf, nan]];
        let mesh = TriangleMesh::new(vertices, vec![], false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
        assert_eq!(reach(&geometry), 1.01 * 5.0);
    }

    /// Unit directions for a grid over the unit square.
    fn directions(cone: &Cone) -> Vec<Vec3> {
        let at = |k: usize| (k as f32 + 0.5) / 64.0;
        let squares = (0..64).flat_map(|i| (0..64).map(move |k| (at(i), at(k))));
        let from = [[1.0; LANES], [-2.0; LANES], [0.5; LANES]];
        let one = |(s, t)| lane(&cone.points(&[[s; LANES], [t; LANES]], &from), 0);
        squares.map(|pair| (one(pair) - Vec3::new(1.0, -2.0, 0.5)) / cone.reach).collect()
    }

    #[test]
    fn directions_are_uniform_in_the_cone() {
        for angle in [0.53, 30.0, 170.0] {
            let cone = cone(angle);
            let half = (angle / 2.0).to_radians();
            let directions = directions(&cone);
            for d in &directions {
                assert!((d.length() - 1.0).abs() < 1e-5);
                let off = d.cross(cone.middle).length().atan2(d.dot(cone.middle));
                assert!(off <= half as f32 + 1e-6, "{angle} {off}");
            }
            // The mean of cosines that are uniform in [cos(half), 1], and no side is preferred.
            let mean = directions.iter().map(|d| f64::from(d.dot(cone.middle))).sum::<f64>();
            let expected = (1.0 + half.cos()) / 2.0;
            assert!((mean / 4096.0 - expected).abs() < 1e-3 * (1.0 - expected) + 1e-6, "{angle}");
            for side in cone.across {
                let mean = directions.iter().map(|d| f64::from(d.dot(side))).sum::<f64>();
                assert!((mean / 4096.0).abs() < 1e-3 * half, "{angle}");
            }
        }
        let point = cone(0.0);
        assert!(directions(&point).iter().all(|d| (*d - point.middle).length() < 1e-6));
    }

    #[test]
    fn the_hull_of_points_and_square_holds_all_rays() {
        for angle in [0.0, 0.53, 10.0, 80.0] {
            let cone = cone(angle);
            let mut points = ShadowPoints::EMPTY;
            for i in 0..LANES {
                let a = i as f32;
                points.hit.0[i] = -1;
                set_lane(&mut points.position, i, Vec3::new(a.sin(), (2.0 * a).cos(), a * 0.05));
                set_lane(&mut points.origin, i, lane(&points.position, i) + Vec3::Y * 0.02);
            }
            let corners = cone.corners(&points).unwrap();
            let center = corners.iter().sum::<Vec3>() / 4.0;
            let half = (corners[1] - corners[0]).length() / 2.0;
            let grid = [0.01, 0.3, 0.5, 0.77, 0.99];
            for (s, t) in grid.iter().flat_map(|&s| grid.map(move |t| (s, t))) {
                let q = cone.points(&[[s; LANES], [t; LANES]], &points.position);
                for i in 0..LANES {
                    // The hull's cross-section between each origin and the square.
                    let o = lane(&points.origin, i);
                    let q = o + (lane(&q, i) - lane(&points.position, i)) * BEYOND;
                    let along = (q - o).dot(cone.middle) / (center - o).dot(cone.middle);
                    assert!(along < 1.0);
                    let middle = o + (center - o) * along;
                    for side in cone.across {
                        assert!((q - middle).dot(side).abs() <= half * along, "{angle}");
                    }
                }
            }
        }
        assert!(cone(120.0).corners(&ShadowPoints::EMPTY).is_none());
    }
}
