//! The point where a ray hits a triangle, in f64 from the f32 vertices.

use glam::DVec3;

use super::double_double::DoubleDouble3;

/// Largest rounding near an edge, for two errors. The triangle test moves a corner by up to 8.5u of
/// its distance; rounding moves a point by up to 5.2u of its coordinate (u = 2^-24). Both are
/// rounded up.
pub const REACH: f64 = 9.0 / (1u64 << 24) as f64;

/// A point on a triangle.
#[derive(Debug, Clone, Copy)]
pub struct TrianglePoint {
    /// `(1 - u - v) v0 + u v1 + v v2`.
    pub position: DVec3,
    /// Unit normal `(v1 - v0) x (v2 - v0)`.
    pub normal: DVec3,
    /// Weight of v1, in [0, 1].
    pub u: f64,
    /// Weight of v2, in [0, 1].
    pub v: f64,
    /// Ray parameter at the triangle's plane; not finite for a ray that lies in the plane.
    pub t: f64,
    /// Whether the ray's line hits the triangle, to f64 rounding.
    pub met: bool,
    /// Whether rounding moves u and v by at most 2.5e-7.
    pub sharp: bool,
    /// Whether an edge may be so close that a test in f32, or the rounding of the point, puts the
    /// point on its other side. Conservative: always true from `sharpen_triangle`.
    pub at_edge: bool,
}

/// Largest rounding error of u and v before `sharpen_triangle` is needed; they must be right to
/// 1e-6.
const SHARP: f64 = 2.5e-7;

/// Clamps barycentric weights to the triangle: u, v >= 0, u + v <= 1. NaN becomes 0.
#[inline(always)]
pub fn clamp_barycentrics(u: f64, v: f64) -> (f64, f64) {
    // Unlike `clamp`, `max` and `min` return the other operand if one is NaN.
    let (u, v) = (f64::min(u.max(0.0), 1.0), f64::min(v.max(0.0), 1.0));
    // The nearest point of the third edge, without a division.
    let beyond = (u + v - 1.0).max(0.0) * 0.5;
    (u - beyond, v - beyond)
}

/// Recomputes the hit of the ray `origin + t direction` on a triangle, clamped to the triangle. The
/// weights (u, v) are the hit that a backend reported.
///
/// The position is the weighted mean of the corners. So it lies on the triangle to f64 rounding
/// from every direction. It lies in the triangle's box even where the corners differ by many orders
/// of magnitude: a sum of edges would cancel there. For a ray in the plane the reported (u, v)
/// decide. [`triangle_error`] bounds the error.
#[inline(always)]
pub fn refine_triangle(
    [v0, v1, v2]: [DVec3; 3],
    origin: DVec3,
    direction: DVec3,
    (u, v): (f64, f64),
) -> TrianglePoint {
    let (e1, e2) = (v1 - v0, v2 - v0);
    let normal = e1.cross(e2);
    let to_v0 = v0 - origin;
    // Barycentrics as ratios of triple products (Moeller and Trumbore 1997, eq. 6).
    let det = normal.dot(direction);
    let r = to_v0.cross(direction);
    let inverse = 1.0 / det;
    let (ru, rv) = (r.dot(e2) * inverse, -r.dot(e1) * inverse);
    let t = normal.dot(to_v0) * inverse;
    let met = (ru >= 0.0) & (rv >= 0.0) & (ru + rv <= 1.0);
    let sound = ru.is_finite() & rv.is_finite();
    let (u, v) = if sound { (ru, rv) } else { (u, v) };
    let (u, v) = clamp_barycentrics(u, v);
    let position = v0 * (1.0 - u - v).max(0.0) + v1 * u + v2 * v;
    // Error bound of the weights: see `triangle_error`.
    let blur = BLUR * sum(to_v0) * sum(direction) * sum(e1).max(sum(e2));
    let sharp = blur * inverse.abs() <= SHARP;
    // The distance from an edge is the weight of the opposite corner times |n| over the length of
    // the edge.
    let (area, side) = (normal.length(), sum(e1) + sum(e2));
    let least = f64::min(f64::min(u, v), 1.0 - u - v);
    let at_edge = !(least * area > REACH * side * (position.abs().max_element() + side));
    let normal = normal * (1.0 / area);
    TrianglePoint { position, normal, u, v, t, met, sharp, at_edge }
}

/// Factor of the error bound in [`triangle_error`]: 64u, u = 2^-53.
const BLUR: f64 = 32.0 * f64::EPSILON;

/// Error bound of each coordinate of the position: its distance from where the ray hits the plane.
/// Valid if that point lies in the triangle. It holds for [`refine_triangle`], and for
/// `sharpen_triangle` where the hit is not `sharp`.
///
/// Each triple product of to_v0, direction and a side has an error of at most 8u times its
/// permanent (u = 2^-53). The permanent is at most the product of the sums of the coordinates'
/// magnitudes. The same holds for det. The sides that the weights multiply are off by u of
/// themselves. Three such errors over det move the weights, and each weight moves the position by a
/// side. 64u leaves room for the rest. With some 106 bits the permanents are the same and each
/// product is off by 2^-100 of them; the divisions add their own rounding.
pub fn triangle_error([v0, v1, v2]: [DVec3; 3], origin: DVec3, direction: DVec3) -> f64 {
    let (e1, e2) = (v1 - v0, v2 - v0);
    let (side1, side2) = (sum(e1), sum(e2));
    let permanent = sum(v0 - origin) * sum(direction) * side1 * side2;
    let fast = BLUR * permanent / e1.cross(e2).dot(direction).abs();
    let moved = if fast <= SHARP * side1.min(side2) {
        fast
    } else {
        // No digit of f64's determinant may be right here.
        let det = volume([v0, v1, v2], direction).abs();
        2f64.powi(-95) * permanent / det + 4.0 * f64::EPSILON * (side1 + side2)
    };
    // Both points lie on the triangle. `min` returns the other operand if one is NaN.
    moved.min(side1 + side2) + 4.0 * f64::EPSILON * (sum(v0) + sum(v1) + sum(v2))
}

/// [`refine_triangle`] with some 106 bits, for needles where f64 has too few digits. Coordinates
/// and direction must be f32 values, so that their differences are exact.
#[cold]
#[inline(never)]
pub fn sharpen_triangle(
    [v0, v1, v2]: [DVec3; 3],
    origin: DVec3,
    direction: DVec3,
    (u, v): (f64, f64),
) -> TrianglePoint {
    let (e1, e2, to_v0) = (
        DoubleDouble3::between(v0, v1),
        DoubleDouble3::between(v0, v2),
        DoubleDouble3::between(origin, v0),
    );
    let way = DoubleDouble3::between(DVec3::ZERO, direction);
    let normal = e1.cross(&e2);
    let det = normal.dot(&way).value();
    let r = to_v0.cross(&way);
    let (ru, rv) = (r.dot(&e2).value() / det, -(r.dot(&e1).value() / det));
    let t = normal.dot(&to_v0).value() / det;
    let met = (ru >= 0.0) & (rv >= 0.0) & (ru + rv <= 1.0);
    let (u, v) = if ru.is_finite() & rv.is_finite() { (ru, rv) } else { (u, v) };
    let (u, v) = clamp_barycentrics(u, v);
    let position = v0 * (1.0 - u - v).max(0.0) + v1 * u + v2 * v;
    let normal = normal.value();
    // The test of the tree moves each corner, so a ray may hit a triangle whose corners lie in a
    // line. Such a triangle faces the ray.
    let normal = if normal == DVec3::ZERO { -direction } else { normal };
    // The square of its length may overflow or underflow.
    let normal = normal / normal.abs().max_element();
    TrianglePoint { position, normal: normal.normalize(), u, v, t, met, sharp: true, at_edge: true }
}

/// Triple product of two sides and the direction, with some 106 bits.
fn volume([v0, v1, v2]: [DVec3; 3], direction: DVec3) -> f64 {
    let normal = DoubleDouble3::between(v0, v1).cross(&DoubleDouble3::between(v0, v2));
    normal.dot(&DoubleDouble3::between(DVec3::ZERO, direction)).value()
}

/// Sum of the magnitudes of the coordinates.
#[inline(always)]
fn sum(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn position_and_weights_of_a_known_hit() {
        let corners = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 4.0];
        let point = refine_triangle(corners, DVec3::new(0.5, 1.0, -3.0), DVec3::Z, (0.0, 0.0));
        assert_eq!(point.position, DVec3::new(0.5, 1.0, 0.0));
        assert_eq!((point.u, point.v), (0.25, 0.25));
        assert_eq!(point.normal, DVec3::Z);
    }

    #[test]
    fn a_ray_in_the_plane_takes_the_reported_weights() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let point = refine_triangle(corners, DVec3::new(-1.0, 0.2, 0.0), DVec3::X, (0.0, 0.2));
        assert_eq!(point.position, DVec3::new(0.0, 0.2, 0.0));
    }

    #[test]
    fn a_near_corner_is_exact_beside_a_far_one() {
        let corners = [DVec3::new(1.0, -7e7, 1.0), DVec3::new(1.0, 5.6e-7, 1.0), DVec3::Z * 2e7];
        let point = refine_triangle(corners, DVec3::new(9.0, 5.6e-7, 1.0), -DVec3::X, (0.0, 0.0));
        assert_eq!(point.position.y as f32, 5.6e-7);
    }

    #[test]
    fn a_triangle_without_area_faces_the_ray() {
        let corners =
            [DVec3::new(-1.0, -0.5, 100.0), DVec3::Z * 100.0, DVec3::new(1.0, 0.5, 100.0)];
        let (origin, direction) = (DVec3::new(0.25, 0.125, 0.0), DVec3::Z * 3.0);
        let point = sharpen_triangle(corners, origin, direction, (0.5, 0.25));
        assert_eq!(point.normal, -DVec3::Z);
        assert_eq!((point.u, point.v), (0.5, 0.25));
    }

    /// A needle that is sixteen decades long.
    #[test]
    fn a_needle_is_refined_with_106_bits() {
        let corners = [
            DVec3::new(3e-8, 1e-8, -2e-8),
            DVec3::new(6.7108864e7, 3.3554432e7, 1.6777216e7),
            DVec3::new(1.34217728e8, 6.7108864e7, 3.3554434e7),
        ]
        .map(|v| v.as_vec3().as_dvec3());
        let (origin, direction) =
            (DVec3::new(0.0, 1048576.0, 4194304.0), DVec3::new(1.0, 0.484375, 0.1875));
        let fast = refine_triangle(corners, origin, direction, (0.0, 0.0));
        let point = sharpen_triangle(corners, origin, direction, (0.0, 0.0));
        assert!(!fast.sharp && point.sharp);
        // The exact ray passes through the second corner, at t = 2^26.
        assert!((point.t / 67_108_864.0 - 1.0).abs() < 1e-12, "{point:?} {fast:?}");
        assert!((point.u - 1.0).abs() < 1e-12 && point.v.abs() < 1e-12, "{point:?} {fast:?}");
        let off = (point.position - corners[1]).abs().max_element();
        let error = triangle_error(corners, origin, direction);
        // Less than half an ulp of f32 there. The bound of f64 alone is larger.
        assert!(off <= error && error < 4.0, "{off} {error}");
    }

    #[test]
    fn refine_and_sharpen_agree_where_f64_is_enough() {
        let corners =
            [DVec3::new(0.5, -1.0, 3.0), DVec3::new(2.0, 0.25, 3.5), DVec3::new(0.0, 4.0, 2.5)];
        let (origin, direction) = (DVec3::new(0.5, 1.0, -3.0), DVec3::new(0.0625, -0.125, 1.0));
        let fast = refine_triangle(corners, origin, direction, (0.0, 0.0));
        let slow = sharpen_triangle(corners, origin, direction, (0.0, 0.0));
        assert!(fast.sharp && fast.met && slow.met);
        let error = triangle_error(corners, origin, direction);
        assert!((fast.position - slow.position).length() <= error && error < 1e-12);
        assert!((fast.normal - slow.normal).length() < 1e-14 && (fast.t - slow.t).abs() < 1e-14);
    }

    #[test]
    fn weights_are_clamped() {
        assert_eq!(clamp_barycentrics(-1e-9, 0.5), (0.0, 0.5));
        assert_eq!(clamp_barycentrics(f64::NAN, 2.0), (0.0, 1.0));
        let (u, v) = clamp_barycentrics(0.9, 0.9);
        assert_eq!((u, v), (0.5, 0.5));
    }

    const CORNERS: [DVec3; 3] =
        [DVec3::new(0.5, -1.0, 3.0), DVec3::new(2.0, 0.25, 3.5), DVec3::new(0.0, 4.0, 2.5)];

    /// A ray to the point of [`CORNERS`] with the weights `u` and `v`.
    fn aimed(u: f64, v: f64) -> TrianglePoint {
        let origin = DVec3::new(0.5, 1.0, -3.0);
        let point = CORNERS[0] * (1.0 - u - v) + CORNERS[1] * u + CORNERS[2] * v;
        refine_triangle(CORNERS, origin, point - origin, (0.0, 0.0))
    }

    #[test]
    fn a_ray_beside_any_edge_misses() {
        assert!(aimed(0.25, 0.5).met);
        for (u, v) in [(-0.01, 0.5), (0.5, -0.01), (0.51, 0.5), (-0.01, -0.01), (1.5, -0.6)] {
            assert!(!aimed(u, v).met, "{u} {v}");
        }
    }

    #[test]
    fn only_points_close_to_an_edge_are_at_an_edge() {
        for (near, expected) in [(1e-8, true), (1e-5, false)] {
            for (u, v) in [(near, 0.5), (0.5, near), (0.5, 0.5 - near)] {
                assert_eq!(aimed(u, v).at_edge, expected, "{u} {v}");
            }
        }
    }

    /// Powers of two scale without rounding.
    #[test]
    fn a_hit_does_not_depend_on_the_unit_of_length() {
        let origin = DVec3::new(0.5, 1.0, -3.0);
        // In the middle; close to an edge; a needle, for which f64 is too coarse.
        let needle = [CORNERS[0], CORNERS[1], CORNERS[1] + DVec3::new(1e-10, 0.0, 0.0)];
        let to = |u: f64, v: f64| CORNERS[0] * (1.0 - u - v) + CORNERS[1] * u + CORNERS[2] * v;
        for (corners, direction) in [
            (CORNERS, to(0.25, 0.5) - origin),
            (CORNERS, to(0.5, 1e-5) - origin),
            (CORNERS, to(0.5, 1e-8) - origin),
            (needle, to(0.5, 0.0) - origin),
        ] {
            let unit = refine_triangle(corners, origin, direction, (0.0, 0.0));
            let error = triangle_error(corners, origin, direction);
            for (scale, length) in
                [(1.0, 1024.0), (1.0, 2f64.powi(-20)), (1024.0, 1.0), (2f64.powi(-20), 1.0)]
            {
                let scaled = corners.map(|v| v * scale);
                let point = refine_triangle(scaled, origin * scale, direction * length, (0.0, 0.0));
                assert_eq!((point.u, point.v, point.normal), (unit.u, unit.v, unit.normal));
                assert_eq!(point.position, unit.position * scale);
                assert_eq!(point.t, unit.t * scale / length);
                let flags = |p: &TrianglePoint| (p.met, p.sharp, p.at_edge);
                assert_eq!(flags(&point), flags(&unit), "{scale} {length}");
                assert_eq!(
                    triangle_error(scaled, origin * scale, direction * length),
                    error * scale
                );
            }
        }
    }

    #[test]
    fn the_error_bound_is_its_formula() {
        let corners =
            [DVec3::new(1.0, 2.0, 4.0), DVec3::new(3.0, 2.0, 4.0), DVec3::new(1.0, 6.0, 4.0)];
        let (origin, direction) = (DVec3::new(0.5, 1.0, -4.0), DVec3::new(0.0, 0.0, 8.0));
        // |v0 - o| = 9.5, |d| = 8, sides 2 and 4, determinant 64; corners 7, 9 and 11.
        let expected = BLUR * 9.5 * 8.0 * 2.0 * 4.0 / 64.0 + 4.0 * f64::EPSILON * 27.0;
        let error = triangle_error(corners, origin, direction);
        assert!((error / expected - 1.0).abs() < 1e-12, "{error:e} {expected:e}");
        // A needle, whose determinant 2^-40 has an error in f64: sides 1 and 1, corners 0, 1 and 1.
        let needle = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 2f64.powi(-40), 0.0)];
        let expected = 2f64.powi(-55) * 3.0 + 4.0 * f64::EPSILON * 4.0;
        let error = triangle_error(needle, DVec3::Z * -3.0, DVec3::Z);
        assert!((error / expected - 1.0).abs() < 1e-6, "{error:e} {expected:e}");
        // Along the plane, the hit may be anywhere on the triangle.
        let error = triangle_error(corners, origin, DVec3::X);
        assert!((error / (6.0 + 4.0 * f64::EPSILON * 27.0) - 1.0).abs() < 1e-15, "{error}");
    }

    #[test]
    fn a_ray_beside_any_edge_misses_with_106_bits_too() {
        let origin = DVec3::new(0.5, 1.0, -3.0);
        let met = |u: f64, v: f64| {
            let point = CORNERS[0] * (1.0 - u - v) + CORNERS[1] * u + CORNERS[2] * v;
            sharpen_triangle(CORNERS, origin, point - origin, (0.0, 0.0)).met
        };
        assert!(met(0.25, 0.5) && met(0.75, 0.125));
        for (u, v) in [(-0.01, 0.5), (0.5, -0.01), (0.51, 0.5), (-0.01, -0.01), (1.5, -0.6)] {
            assert!(!met(u, v), "{u} {v}");
        }
    }

    /// The square of the normal's length overflows and underflows.
    #[test]
    fn normals_of_huge_and_tiny_triangles_have_unit_length() {
        for scale in [2f64.powi(300), 2f64.powi(-300)] {
            let corners = [DVec3::ZERO, DVec3::X * scale, DVec3::Y * scale];
            let point = sharpen_triangle(corners, DVec3::Z, -DVec3::Z, (0.0, 0.0));
            assert_eq!(point.normal, DVec3::Z);
        }
    }
}
