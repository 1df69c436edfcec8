//! How closely a ray passes a triangle: within the error of an f32 test, the hit counts.

use glam::{DVec2, DVec3};

/// How far rounding may move a corner across the ray, as a fraction of its largest coordinate from
/// the ray's origin.
///
/// A test in f32 takes the corners relative to the ray's origin, with an error of u = 2^-24 per
/// coordinate. A watertight test that works across the ray (Woop et al. 2013) moves corners by 6u
/// in all and is exact after that. This constant allows four times as much, as `crosscheck` does.
///
/// Embree's ROBUST test works in space. For an edge with corners A, B it takes the sign of ((B - A)
/// x (A + B)) . D, to a slack of 2^-23 |U + V + W|. Differences, sums and products of one term
/// round seven times in all. A permanent is at most 1.16 times the product of its rows' lengths (6
/// / 27^0.5). So the value is off by at most 9u |B - A| |A + B| |D|. The exact value is the ray's
/// distance from the edge's line times 2 |(B - A) x D|. So the ray seems to move by at most 9u of
/// the farther corner's distance over the sine of the angle between edge and ray. For edges across
/// the ray that is within 24u, except for a diagonal ray whose errors all add up. For edges along
/// the ray it grows without limit, and so does the error of t: those are the false hits. Moeller
/// and Trumbore's test (`--fast`) has the same terms with one corner in place of the sum.
///
/// Rejecting hits beyond 24u never rejects a triangle that the exact ray hits. It never rejects a
/// triangle at whose edge or corner the ray is aimed: such a ray is rounded by 2u at most. So the
/// fan around a vertex stays as closed as Embree sees it. A ray could be lost only where Embree's
/// error at an edge exceeds 24u, where its hit is on the wrong triangle.
/// `tests/library/hits/true_hits` looks for such rays along the edges of needles and plates.
const REACH: f64 = 24.0 / (1u64 << 24) as f64;

/// Where a ray passes a triangle within `REACH`.
#[derive(Debug, Clone, Copy)]
pub struct Passing {
    /// Ray parameter at the plane, clamped to the range of the corners.
    pub t: f64,
    /// Bound of the error of t in a test with moved corners, rounding to f32 included.
    pub t_error: f64,
}

impl Passing {
    /// Whether a reported t is this one, up to the error of a test in f32.
    pub fn explains(&self, t: f64) -> bool {
        (self.t - t).abs() <= self.t_error
    }
}

/// Where the line `origin + t direction` passes a triangle. `None` if it is farther off than a test
/// in f32 can err. Coordinates and direction must be f32 values; the rounding of f64 is a millionth
/// of `REACH`.
pub fn passing(corners: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<Passing> {
    let along = direction.abs().max_position();
    let across = [(along + 1) % 3, (along + 2) % 3];
    let forward = direction[along];
    let shear = DVec2::new(direction[across[0]], direction[across[1]]) / forward;
    let seen = corners.map(|corner| corner - origin);
    let flat = seen.map(|a| DVec2::new(a[across[0]], a[across[1]]) - shear * a[along]);
    let moved = seen.iter().fold(0.0, |most: f64, a| most.max(a.abs().max_element())) * REACH;
    // Seen edge-on, the signs mean nothing: all sides are 0 or noise, also beyond the ends.
    let (least, most) = (flat[0].min(flat[1]).min(flat[2]), flat[0].max(flat[1]).max(flat[2]));
    if least.max_element() > moved || most.min_element() < -moved {
        return None;
    }
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (flat[i], flat[j]));
    let sides = edges.map(|(p, q)| p.perp_dot(q));
    let inside = sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s <= 0.0);
    if !inside && !edges.iter().any(|&(p, q)| from_segment(p, q) <= moved) {
        return None;
    }
    let [a, b, c] = seen.map(|corner| corner[along] / forward);
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let normal = (seen[1] - seen[0]).cross(seen[2] - seen[0]);
    let facing = normal.dot(direction);
    let t = normal.dot(seen[0]) / facing;
    let t = if t.is_nan() { low } else { t.clamp(low, high) };
    // A corner that moves by (x, y) across the ray moves the plane along the ray by n.(x, y) / n.d.
    let slid = moved * (normal[across[0]].abs() + normal[across[1]].abs()) / facing.abs();
    let slid = if slid.is_nan() { high - low } else { slid.min(high - low) };
    Some(Passing { t, t_error: slid + 4.0 * f64::from(f32::EPSILON) * t.abs() })
}

/// Distance of the point (0, 0) from a segment.
fn from_segment(p: DVec2, q: DVec2) -> f64 {
    let along = q - p;
    let s = -p.dot(along) / along.length_squared();
    let s = if s.is_nan() { 0.0 } else { s.clamp(0.0, 1.0) };
    (p + along * s).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    /// A ray of slope 0.1 through (x, 0.25, 0), from a height of 10.
    fn through(x: f64) -> Option<Passing> {
        passing(CORNERS, DVec3::new(x - 1.0, 0.25, 10.0), DVec3::new(0.1, 0.0, -1.0))
    }

    #[test]
    fn the_tolerance_scales_with_the_farthest_corner() {
        let reach = 10.0 * REACH;
        for x in [0.5, 0.0, -0.99 * reach] {
            let met = through(x).unwrap();
            assert!((met.t - 10.0).abs() <= met.t_error, "{x}");
            assert!(met.t_error < 10.0 * 1e-6);
        }
        assert!(through(-1.01 * reach).is_none());
        assert!(through(0.75 + 1.01 * reach * 2f64.sqrt()).is_none());
    }

    #[test]
    fn t_of_a_ray_in_the_plane_lies_within_the_triangle() {
        let met = passing(CORNERS, DVec3::new(-3.0, 0.5, 0.0), DVec3::X).unwrap();
        assert!(met.t >= 3.0 && met.t <= 4.0 && met.t_error >= 1.0);
        assert!(passing(CORNERS, DVec3::new(-3.0, 1.1, 0.0), DVec3::X).is_none());
        // Parallel to the plane, above it.
        assert!(passing(CORNERS, DVec3::new(-3.0, 0.5, 1e-3), DVec3::X).is_none());
    }

    #[test]
    fn t_is_clamped_to_the_corners() {
        let met = passing(CORNERS, DVec3::new(-3.0, 0.5, 1e-7), DVec3::new(1.0, 0.0, -1e-9));
        assert_eq!(met.unwrap().t, 4.0);
    }

    #[test]
    fn the_error_of_t_follows_from_the_slope_of_the_triangle() {
        let down = |corners, origin| passing(corners, origin, -DVec3::Z).unwrap();
        let origin = DVec3::new(0.25, 0.25, 10.0);
        let rounding = 4.0 * f64::from(f32::EPSILON);
        // The ray is perpendicular to the plane.
        assert_eq!(down(CORNERS, origin).t_error, rounding * 10.0);
        // The normal is (-1, -2, 1), and the farthest coordinate is 10.
        let sloping = [DVec3::ZERO, DVec3::new(1.0, 0.0, 1.0), DVec3::new(0.0, 1.0, 2.0)];
        for corners in [sloping, [sloping[1], sloping[0], sloping[2]]] {
            let met = down(corners, origin);
            let error = 3.0 * 10.0 * REACH + rounding * 9.25;
            assert!((met.t - 9.25).abs() < 1e-12 && (met.t_error / error - 1.0).abs() < 1e-9);
            assert!(met.explains(9.25 - 0.99 * error) && met.explains(9.25 + 0.99 * error));
            assert!(!met.explains(9.25 - 1.01 * error) && !met.explains(9.25 + 1.01 * error));
        }
        // A grazing ray: t may be anywhere between the corners, which are 1 apart.
        let grazing = passing(CORNERS, DVec3::new(-3.0, 0.5, 1e-7), DVec3::new(1.0, 0.0, -1e-9));
        let along = passing(CORNERS, DVec3::new(-3.0, 0.5, 0.0), DVec3::X);
        for met in [grazing.unwrap(), along.unwrap()] {
            assert_eq!(met.t_error, 1.0 + rounding * met.t);
        }
    }

    #[test]
    fn a_ray_in_the_plane_is_off_beyond_both_ends() {
        for y in [-0.1, 1.1] {
            assert!(passing(CORNERS, DVec3::new(-3.0, y, 0.0), DVec3::X).is_none());
        }
    }

    #[test]
    fn t_of_a_ray_along_a_needle_may_be_anywhere_on_it() {
        let needle = [DVec3::ZERO, DVec3::Z, DVec3::Z * 2.0];
        let met = passing(needle, DVec3::Z * 10.0, -DVec3::Z).unwrap();
        assert_eq!(met.t, 8.0);
        assert_eq!(met.t_error, 2.0 + 4.0 * f64::from(f32::EPSILON) * 8.0);
    }
}
