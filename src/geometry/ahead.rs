//! Decides whether a ray hits a plane after its start.
//!
//! A ray starts after its origin, so a plane that contains the origin is no hit. In f64 the
//! parameter of such a plane is zero or noise of either sign. So near zero the sign is decided with
//! some 106 bits.

use glam::DVec3;

use super::double_double::DoubleDouble3;

/// A hit nearer than this fraction of the triangle's farthest coordinate may lie at the ray's
/// origin.
pub const NEAR_START: f64 = 1.0 / (1u64 << 12) as f64;

/// Whether a hit of a triangle lies after the ray's start. `t` is the ray parameter computed in
/// f64.
#[inline(always)]
pub fn is_after_start(corners: [DVec3; 3], origin: DVec3, direction: DVec3, t: f64) -> bool {
    let seen = corners.map(|v| v - origin);
    let [a, b, c] = seen.map(DVec3::abs);
    let far = a.max(b).max(c).max_element();
    if t * direction.abs().max_element() > NEAR_START * far {
        return true;
    }
    // If the whole triangle lies ahead along the dominant axis, so does every hit. The axis is the
    // one that `bvh` chooses.
    let [x, y, z] = direction.abs().to_array();
    let along = if z >= x.max(y) { 2 } else { usize::from(y >= x) };
    let sign = direction[along].signum();
    seen.iter().all(|v| v[along] * sign > 0.0) || is_ahead(corners, origin, direction, t)
}

/// Whether `origin + t direction` hits the plane of a triangle at t > 0; false if the origin lies
/// in the plane. For a ray along the plane, the given `t` decides. Coordinates must be f32 values,
/// so that the products of their differences are exact: see below.
#[cold]
#[inline(never)]
fn is_ahead([v0, v1, v2]: [DVec3; 3], origin: DVec3, direction: DVec3, t: f64) -> bool {
    let (e1, e2) = (DoubleDouble3::between(v0, v1), DoubleDouble3::between(v0, v2));
    let normal = e1.cross(&e2);
    let way = DoubleDouble3::between(DVec3::ZERO, direction);
    let towards = normal.dot(&way).value();
    if towards == 0.0 {
        return t > 0.0;
    }
    let above = normal.dot(&DoubleDouble3::between(origin, v0)).value();
    // Products of differences of f32 fit into 106 bits unless their exponents are far apart: 0 is
    // exact.
    above != 0.0 && (above > 0.0) == (towards > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_not_ahead_of_itself() {
        let corners = [[0.1f32, 0.7, -0.3], [1.3, 0.2, 0.9], [-0.6, 0.4, 0.35]]
            .map(|v| DVec3::from(v.map(f64::from)));
        for origin in corners {
            for direction in [DVec3::X, DVec3::new(0.3, -0.9, 0.2), -DVec3::Z] {
                assert!(!is_ahead(corners, origin, direction, 1e-17));
            }
        }
    }

    #[test]
    fn a_hair_away_is_ahead_or_behind() {
        let corners = [DVec3::new(-1.0, 0.0, -1.0), DVec3::X, DVec3::Z];
        let above = DVec3::new(0.1, 2f64.powi(-80), 0.2);
        let ahead = |direction: DVec3| is_ahead(corners, above, direction, 1e-17);
        assert!(ahead(-DVec3::Y) && !ahead(DVec3::Y));
        assert!(is_after_start(corners, above - DVec3::Y, DVec3::Y, 1.0));
    }

    /// f64 computes t with an error of either sign where the plane contains the origin.
    #[test]
    fn a_plane_through_the_origin_is_not_hit_whatever_t_says() {
        let plain = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let direction = DVec3::new(0.25, 0.25, 1.0);
        for t in [-1e-9, 0.0, 1e-17, 1e-9] {
            assert!(!is_after_start(plain, DVec3::ZERO, direction, t), "{t}");
            // Far from the scene's origin.
            let origin = DVec3::new(128.0, 64.0, 32.0);
            assert!(!is_after_start(plain.map(|v| v + origin), origin, direction, t), "{t}");
            // All corners are at depth 0 along the dominant axis.
            assert!(!is_after_start(plain, DVec3::new(0.25, 0.25, 0.0), DVec3::Z, t), "{t}");
        }
        // The error grows with the triangle. A long direction makes t small.
        let large = plain.map(|v| v * 1e6);
        assert!(!is_after_start(large, DVec3::ZERO, direction, 1e-3));
        assert!(!is_after_start(large, DVec3::ZERO, direction * 1e-6, 1e3));
        assert!(!is_after_start(plain, DVec3::ZERO, direction * 1e-6, 1e-3));
    }

    #[test]
    fn a_triangle_ahead_is_hit_and_one_behind_is_not() {
        let corners = [DVec3::new(0.5, -1.0, -1.0), DVec3::new(0.5, 1.0, -1.0), DVec3::X];
        for (scale, t) in [(1.0, 0.5), (1e-6, 0.5e-6), (1e6, 0.5e6)] {
            let corners = corners.map(|v| v * scale);
            assert!(is_after_start(corners, DVec3::ZERO, DVec3::X, t));
            assert!(!is_after_start(corners, DVec3::ZERO, -DVec3::X, -t));
        }
    }

    #[test]
    fn t_decides_for_a_ray_in_the_plane() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let ahead = |t| is_ahead(corners, DVec3::new(-1.0, 0.25, 0.0), DVec3::X, t);
        assert!(ahead(1.0) && !ahead(0.0) && !ahead(-1.0));
    }
}
