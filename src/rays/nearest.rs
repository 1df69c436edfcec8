//! The points of the meshes that are nearest to given points.

use glam::DVec3;

use super::inside::check_points;
use super::progress::{self, CHUNK};
use super::scene::RayScene;
use crate::accel::bvh::Bvh;
use crate::error::Result;
use crate::monitor::Monitor;
use crate::parallel;
use crate::reserve;

/// Nearest points on the meshes, an element for each point.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosestPoints {
    /// The nearest point of all faces.
    pub point: Vec<[f64; 3]>,
    /// Its distance, >= 0.
    pub distance: Vec<f64>,
    /// Its face in the mesh. Of faces whose rounded distances are equal, that of the lowest mesh,
    /// then the lowest wins.
    pub primitive: Vec<i64>,
    /// Index of the mesh.
    pub mesh: Vec<i32>,
}

/// The nearest point so far.
struct Nearest {
    squared: f64,
    point: DVec3,
    primitive: u32,
}

impl Nearest {
    const NONE: Self = Self { squared: f64::INFINITY, point: DVec3::NAN, primitive: 0 };
}

impl RayScene {
    /// Finds the nearest point of the meshes to each point, in f64 from the caller's arrays.
    ///
    /// # Errors
    /// `Invalid` for a point that is not finite or beyond 1e18. Also those of
    /// [`RayScene::all_hits`].
    pub fn closest_point(&self, points: &[[f64; 3]], monitor: &Monitor) -> Result<ClosestPoints> {
        check_points(points)?;
        let bvh = self.bvh()?;
        let chunks = progress::in_chunks(points.len(), monitor, |range| {
            Ok(points[range].iter().map(|&p| self.nearest(&bvh, p.into())).collect::<Vec<_>>())
        })?;
        let (count, nearest) = (points.len(), |i: usize| &chunks[i / CHUNK][i % CHUNK]);
        let place = |i: usize| self.place(nearest(i).primitive);
        let mut found = ClosestPoints {
            point: reserve::filled([0.0; 3], count, "point")?,
            distance: reserve::filled(0.0, count, "distance")?,
            primitive: reserve::filled(0, count, "primitive")?,
            mesh: reserve::filled(0, count, "mesh")?,
        };
        parallel::fill(&mut found.point, |i| nearest(i).point.to_array());
        parallel::fill(&mut found.distance, |i| nearest(i).squared.sqrt());
        parallel::fill(&mut found.primitive, |i| place(i).1 as i64);
        parallel::fill(&mut found.mesh, |i| place(i).0 as i32);
        Ok(found)
    }

    fn nearest(&self, bvh: &Bvh, point: DVec3) -> Nearest {
        let local = point - self.origin();
        let mut best = Nearest::NONE;
        let slack = self.slack(local.abs().max_element());
        // 2^-48 of the largest coordinate: more than the rounding of a distance, but for needles.
        // Their normal is rounded by 2^-53 of length / width.
        let error = f64::from(slack) * 0.5f64.powi(26)
            + self.origin().abs().max_element() * 0.5f64.powi(48);
        let mut limit = f64::INFINITY;
        bvh.visit_nearest(local.as_vec3().to_array(), slack, |primitive| {
            let corners = self.corners(primitive);
            let squared = |on: DVec3| (on - point).length_squared();
            // Only faces that are nearer or may be as near are computed with sorted corners.
            if squared(nearest_on_triangle(corners, point)) <= limit {
                let on = nearest_on_triangle(sorted(corners), point);
                let squared = squared(on);
                let lower = squared == best.squared && primitive < best.primitive;
                if squared < best.squared || lower {
                    best = Nearest { squared, point: on, primitive };
                    limit = (squared.sqrt() + error).powi(2);
                }
            }
            best.squared
        });
        best
    }
}

/// Returns corners in the order of their coordinates. So equal faces, and faces that share an edge,
/// round a common nearest point in the same way, and their distances are equal.
fn sorted([mut a, mut b, mut c]: [DVec3; 3]) -> [DVec3; 3] {
    let order = |p: &mut DVec3, q: &mut DVec3| {
        if q.to_array() < p.to_array() {
            std::mem::swap(p, q);
        }
    };
    order(&mut a, &mut b);
    order(&mut b, &mut c);
    order(&mut a, &mut b);
    [a, b, c]
}

/// Square of the distance from a plane, in lengths of the triangle's longest edge, from which the
/// nearest point is computed by weights.
const FAR: f64 = 16.0;

/// Returns the point of a triangle that is nearest to `p`. A point on an edge is computed from the
/// ends of that edge alone. Source: Ericson 2005, "Real-Time Collision Detection", 5.1.5, with
/// products of the normal in place of differences of dot products. Those cancel on thin triangles.
fn nearest_on_triangle([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, bc, ac) = (b - a, c - b, c - a);
    let (ap, bp, cp) = (p - a, p - b, p - c);
    if ab.dot(ap) <= 0.0 && ac.dot(ap) <= 0.0 {
        return a;
    }
    if ab.dot(bp) >= 0.0 && bc.dot(bp) <= 0.0 {
        return b;
    }
    if ac.dot(cp) >= 0.0 && bc.dot(cp) >= 0.0 {
        return c;
    }
    let [ab2, bc2, ac2] = [ab, bc, ac].map(DVec3::length_squared);
    let longest = ab2.max(bc2).max(ac2);
    // The two shorter edges round the normal the least. `shorter` is the square of their product.
    let (normal, shorter) = if longest == ac2 {
        (ab.cross(bc), ab2 * bc2)
    } else if longest == ab2 {
        (ac.cross(bc), ac2 * bc2)
    } else {
        (ab.cross(ac), ab2 * ac2)
    };
    let normal2 = normal.length_squared();
    // Else the triangle is narrower than its plane is rounded, if it is obtuse: less than 1.5e-8 of
    // its length. Then the nearest point of its edges is as near, but for its width.
    let has_plane = normal2 > f64::EPSILON * shorter.sqrt() * longest;
    let side = |edge: DVec3, from_end: DVec3| normal.dot(edge.cross(from_end));
    let mut nearest = None;
    for (beyond, edge, length2, [low, high], from_low) in [
        (side(ab, ap) <= 0.0, ab, ab2, [a, b], ap),
        (side(bc, bp) <= 0.0, bc, bc2, [b, c], bp),
        (side(ac, ap) >= 0.0, ac, ac2, [a, c], ap),
    ] {
        if beyond || !has_plane {
            let along = edge.dot(from_low);
            let on = if along <= 0.0 {
                low
            } else if along >= length2 {
                high
            } else {
                low + edge * (along / length2)
            };
            // Squares of the distances would be equal from afar, rounded.
            let is_nearer = |other: DVec3| (on - other).dot((on - p) + (other - p)) < 0.0;
            if nearest.is_none_or(is_nearer) {
                nearest = Some(on);
            }
        }
    }
    if let Some(on) = nearest {
        return on;
    }
    let height = normal.dot(ap) / normal2;
    if height * height * normal2 <= FAR * longest {
        return p - normal * height;
    }
    // From afar the difference would cancel. The weights are rounded as much, but lead to the face.
    let weights = [side(bc, bp), -side(ac, ap), side(ab, ap)];
    let inverse = 1.0 / weights.into_iter().sum::<f64>();
    let [u, v, w] = weights.map(|weight| weight * inverse);
    a * u + b * v + c * w
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, Positions};

    /// Beyond two edges of an obtuse corner, one of them is the nearest.
    #[test]
    fn the_nearest_edge_of_distant_points_is_found() {
        let [a, b, c] =
            [[0.1, 0.7, -0.3], [1.3, 0.2, 0.9], [2.6, 0.4, 1.35]].map(|v: [f64; 3]| DVec3::from(v));
        let normal = (b - a).cross(c - a);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let outward = (to - from).cross(normal).normalize();
            for i in 1..20 {
                let goal = from.lerp(to, f64::from(i) / 20.0);
                for distance in [0.5, 1e3, 1e6, 1e7, 3e7, 1e8, 1e9, 1e10] {
                    let on = nearest_on_triangle(sorted([a, b, c]), goal + outward * distance);
                    let off = (on - goal).length();
                    assert!(off < 1e-14 + 1e-15 * distance, "{distance:e} {goal} {on}");
                }
            }
        }
    }

    #[test]
    fn points_nearest_to_distant_points_lie_on_the_face() {
        let corners @ [a, b, c] = [[0.1, 0.7, -0.3], [1.3, 0.2, 0.9], [-0.6, 0.4, 0.35]]
            .map(|v: [f64; 3]| DVec3::from(v));
        let normal = (b - a).cross(c - a).normalize();
        for distance in [0.5, 3.0, 1e3, 1e6, 1e9, 1e12, 1e17] {
            let goal = a * 0.3 + b * 0.3 + c * 0.4;
            let on = nearest_on_triangle(sorted(corners), goal + normal * distance);
            assert!(normal.dot(on - a).abs() < 1e-15, "{distance:e} {on}");
            assert!((on - goal).length() <= 1e-15 * (distance + 1.0), "{distance:e} {on}");
        }
    }

    /// Irregular points, above the edges of a triangle too.
    #[test]
    fn the_order_of_the_corners_does_not_matter() {
        let corners @ [a, b, c] = [[0.1, 0.7, -0.3], [1.3, 0.2, 0.9], [-0.6, 0.4, 0.35]]
            .map(|v: [f64; 3]| DVec3::from(v));
        for i in 0..1000 {
            let weight = |k: i32| f64::from(i * k % 101) / 40.0 - 0.8;
            let p = a + (b - a) * weight(7) + (c - a) * weight(13) + DVec3::splat(weight(29));
            let on = nearest_on_triangle(sorted(corners), p);
            for order in [[a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]] {
                assert_eq!(nearest_on_triangle(sorted(order), p), on, "{p}");
            }
        }
    }

    /// Strips in planes turned by a matrix of integers, so that all distances are known.
    #[test]
    fn thin_faces_are_as_far_as_they_are() {
        let turn = |v: [f64; 3]| {
            let columns = [[2.0, 1.0, 2.0], [-2.0, 2.0, 1.0], [1.0, 2.0, -2.0]].map(DVec3::from);
            columns[0] * v[0] + columns[1] * v[1] + columns[2] * v[2]
        };
        let length = 1024.0;
        for (width, height) in [-3, -7, -20]
            .into_iter()
            .flat_map(|w| [0.0, 2f64.powi(-12), 1.0, 512.0].map(|height| (2f64.powi(w), height)))
        {
            // The strip of two faces, and of three, of which one is a flat cap.
            let [a, b, c, d] =
                [[0.0; 3], [length, 0.0, 0.0], [length, width, 0.0], [0.0, width, 0.0]];
            let middle = [length / 2.0, width, 0.0];
            for i in 0..1000 {
                let weight = |k: i32| f64::from(i * k % 101) / 128.0;
                let (x, y) = (length * weight(7), width * weight(13));
                let p = turn([x, y, height]);
                let least = |faces: &[[[f64; 3]; 3]]| {
                    let faces = faces.iter().map(|&face| sorted(face.map(turn)));
                    faces.map(|f| (nearest_on_triangle(f, p) - p).length()).fold(1e9, f64::min)
                };
                let rounding = length * 2f64.powi(-48);
                let strip = least(&[[a, b, c], [a, c, d]]);
                assert!((strip - 3.0 * height).abs() <= rounding, "{width:e} {p} {strip:e}");
                // Of narrower caps only the edges count.
                let rounding = if width > 1e-4 { rounding } else { 3.0 * width };
                let caps = least(&[[a, b, middle], [a, middle, d], [b, c, middle]]);
                assert!((caps - 3.0 * height).abs() <= rounding, "{width:e} {p} {caps:e}");
            }
        }
    }

    /// A ridge, whose faces lie below it: it is nearest to all points high above.
    #[test]
    fn faces_that_share_an_edge_share_the_nearest_point_on_it() {
        let [a, b] = [[0.1, 0.7, -0.3], [1.3, 0.2, -0.1]].map(|v: [f64; 3]| DVec3::from(v));
        let others = [[0.3, -1.1, -2.0], [1.1, 2.3, -2.2], [2.7, 1.3, -0.9]]
            .map(|v: [f64; 3]| DVec3::from(v));
        let vertices = [&[a, b][..], &others[..]].concat();
        let positions = Positions::F64(vertices.iter().map(|v| v.to_array()).collect());
        let mesh = Mesh::new(positions, vec![[2, 1, 0], [1, 3, 0], [0, 1, 4]]).expect("a mesh");
        let scene = RayScene::new(vec![Box::new(mesh)], &Monitor::default()).expect("a scene");
        let mut between = 0;
        for i in 0..1000 {
            let weight = |k: i32| f64::from(i * k % 101) / 101.0;
            let up = DVec3::new(weight(13) - 0.5, weight(29) - 0.5, 2.0 + weight(53));
            let p = a + (b - a) * weight(7) + up;
            let on = others.map(|c| nearest_on_triangle(sorted([c, b, a]), p));
            assert_eq!((on[0], on[1]), (on[2], on[2]), "{p}");
            between += usize::from(on[0] != a && on[0] != b);
            // The lowest of equally near faces wins.
            let found = scene.closest_point(&[p.to_array()], &Monitor::default());
            let found = found.expect("a finite point");
            assert_eq!((found.primitive[0], found.point[0]), (0, on[0].to_array()), "{p}");
        }
        assert!(between > 500);
    }

    /// Every order of three corners of which two coincide, and of three equal ones.
    #[test]
    fn the_nearest_point_of_a_segment_is_found_in_every_order() {
        let (a, b) = (DVec3::ZERO, DVec3::X);
        for (p, expected) in [
            (DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.5, 0.0, 0.0)),
            (DVec3::new(-2.0, 1.0, 0.0), a),
            (DVec3::new(3.0, 0.0, 1.0), b),
        ] {
            for corners in [[a, a, b], [a, b, a], [b, a, a], [b, b, a], [b, a, b], [a, b, b]] {
                assert_eq!(nearest_on_triangle(corners, p), expected, "{corners:?}");
            }
            assert_eq!(nearest_on_triangle([a; 3], p), a);
        }
    }
}
