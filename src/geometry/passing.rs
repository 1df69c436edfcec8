//! Whether a ray passes a triangle so closely that a test in f32 may meet it, and where.

use glam::{DVec2, DVec3};

/// How far a corner may seem to have moved across the ray, in units of its largest coordinate from
/// the ray's origin.
///
/// A test in f32 sees corners relative to the ray's origin, each coordinate of that difference off by
/// u = 2^-24 of it. A watertight test that works across the ray (Woop et al. 2013) moves corners by 6u
/// in all and decides what it then sees exactly; this allows four times as much, as `crosscheck` does.
///
/// Embree's ROBUST test works in space: with A, B the corners of an edge, the sign of
/// ((B - A) x (A + B)) . D, to a slack of 2^-23 |U + V + W|. Differences, sums and products of one term
/// round seven times in all, and a permanent is at most 1.16 times the product of its rows' lengths
/// (6 / 27^0.5): the value is off by at most 9u |B - A| |A + B| |D|. The exact one is the ray's distance from
/// the edge's line times 2 |(B - A) x D|, so the ray seems to be elsewhere by at most 9u of the farther
/// corner's distance over the sine of the angle between edge and ray. For edges across the ray that is
/// within 24u but for a diagonal ray whose errors all add up. For edges along the ray it grows without
/// limit, and so does the error of t: those are the false hits. Moeller and Trumbore's test (`--fast`) has
/// the same terms with one corner for their sum.
///
/// What discarding beyond 24u can and cannot lose: a triangle that the exact ray meets is never
/// discarded, nor one with an edge or a corner that a ray is aimed at, as the rounding of such a ray is 2u at
/// most, so the fan around it stays as closed as Embree sees it. A ray could be lost only where Embree puts it
/// on the wrong side of an edge by more than 24u, where its hit is on the wrong triangle:
/// `tests/true_hits` looks for such rays along the edges of needles and plates.
const REACH: f64 = 24.0 / (1u64 << 24) as f64;

/// Where a ray passes a triangle within that reach.
#[derive(Debug, Clone, Copy)]
pub struct Passing {
    /// Where it meets the plane, not beyond the corners' own.
    pub t: f64,
    /// How far a test whose corners have moved may be from that, rounding to f32 included.
    pub t_error: f64,
}

impl Passing {
    /// Whether a reported t is this one, for all that a test in f32 may be off.
    pub fn explains(&self, t: f64) -> bool {
        (self.t - t).abs() <= self.t_error
    }
}

/// Where the line `origin + t direction` passes a triangle, or `None` if not within the reach
/// of a test in f32. Coordinates and direction are values of f32; the rounding of f64 is a millionth of
/// that reach.
pub fn passing(corners: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<Passing> {
    let along = direction.abs().max_position();
    let across = [(along + 1) % 3, (along + 2) % 3];
    let forward = direction[along];
    let shear = DVec2::new(direction[across[0]], direction[across[1]]) / forward;
    let seen = corners.map(|corner| corner - origin);
    let flat = seen.map(|a| DVec2::new(a[across[0]], a[across[1]]) - shear * a[along]);
    let moved = seen.iter().fold(0.0, |most: f64, a| most.max(a.abs().max_element())) * REACH;
    // Seen edge-on the sides tell nothing: all are 0, or noise, beyond the ends as well.
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
    // A corner that moves by (x, y) across the ray moves the plane along it by n.(x, y) / n.d.
    let slid = moved * (normal[across[0]].abs() + normal[across[1]].abs()) / facing.abs();
    let slid = if slid.is_nan() { high - low } else { slid.min(high - low) };
    Some(Passing { t, t_error: slid + 4.0 * f64::from(f32::EPSILON) * t.abs() })
}

/// Distance of the origin from a segment.
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

    /// Rays of slope 0.1 through (x, 0.25, 0), from 10 above.
    fn through(x: f64) -> Option<Passing> {
        passing(CORNERS, DVec3::new(x - 1.0, 0.25, 10.0), DVec3::new(0.1, 0.0, -1.0))
    }

    #[test]
    fn the_reach_is_that_of_the_farthest_corner() {
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
    fn a_ray_in_the_plane_is_somewhere_along_the_triangle() {
        let met = passing(CORNERS, DVec3::new(-3.0, 0.5, 0.0), DVec3::X).unwrap();
        assert!(met.t >= 3.0 && met.t <= 4.0 && met.t_error >= 1.0);
        assert!(passing(CORNERS, DVec3::new(-3.0, 1.1, 0.0), DVec3::X).is_none());
        // Above the plane, along it.
        assert!(passing(CORNERS, DVec3::new(-3.0, 0.5, 1e-3), DVec3::X).is_none());
    }

    #[test]
    fn t_stays_within_the_corners() {
        let met = passing(CORNERS, DVec3::new(-3.0, 0.5, 1e-7), DVec3::new(1.0, 0.0, -1e-9));
        assert_eq!(met.unwrap().t, 4.0);
    }
}
