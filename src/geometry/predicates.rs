//! Exact predicates of f64 points: half-lines and segments against triangles.
//!
//! The determinants are those of Shewchuk 1997, "Adaptive Precision Floating-Point Arithmetic and
//! Fast Robust Geometric Predicates" (crate `robust`). Their signs are exact if no product
//! underflows or overflows. Magnitudes of coordinates that are 0, or between 1e-70 and 1e70, are
//! enough for that. The caller must ensure them: [`RayScene`](crate::RayScene) limits them to 1e18,
//! and does not look for tiny ones.

use robust::{Coord, Coord3D, orient2d, orient3d};

/// How a half-line intersects a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HalfLineIntersection {
    /// The half-line neither crosses the triangle nor starts on it. A triangle parallel to the
    /// half-line is never crossed.
    Misses,
    /// The half-line crosses the triangle. At edges and vertices a tie rule assigns each crossing
    /// of a surface to one triangle.
    Crosses,
    /// The half-line starts on the triangle, edges and corners included.
    Starts,
}

/// Returns how the half-line from `point` along axis `axes[2]` intersects a triangle. It runs
/// towards larger coordinates if `upward`, else towards smaller ones. `axes` must be a cyclic
/// permutation of 0, 1, 2.
///
/// Tie rule (simulation of simplicity): the half-line counts as moved by (e, e^2) along `axes[0]`
/// and `axes[1]`, with e > 0 infinitely small. The moved line passes through no edge and no vertex.
/// The move is the same for all triangles. So an odd number of crossings of a closed mesh means
/// that the point is inside.
pub fn half_line(
    corners: [[f64; 3]; 3],
    point: [f64; 3],
    axes: [usize; 3],
    upward: bool,
) -> HalfLineIntersection {
    let flat = |p: [f64; 3]| [p[axes[0]], p[axes[1]]];
    let ([a, b, c], p) = (corners.map(flat), flat(point));
    let sides = [orientation(b, c, p), orientation(c, a, p), orientation(a, b, p)];
    if is_mixed(sides) {
        return HalfLineIntersection::Misses;
    }
    if sides == [0; 3] {
        // The triangle is parallel to the half-line, and both lie in one plane.
        return if is_on(corners, point) {
            HalfLineIntersection::Starts
        } else {
            HalfLineIntersection::Misses
        };
    }
    // 1 if the corners appear clockwise from the point, -1 if counterclockwise.
    let below = side_of_plane(corners, point);
    if below == 0 {
        return HalfLineIntersection::Starts;
    }
    let moved = [or_tie(sides[0], b, c), or_tie(sides[1], c, a), or_tie(sides[2], a, b)];
    if moved[0] == 0 || moved[0] != moved[1] || moved[1] != moved[2] {
        return HalfLineIntersection::Misses;
    }
    let is_above_point = below == moved[0];
    if is_above_point == upward {
        HalfLineIntersection::Crosses
    } else {
        HalfLineIntersection::Misses
    }
}

/// Whether the open segment from `from` to `to` passes through a triangle, edges and corners
/// included. False if one of the points lies in the plane of the triangle.
pub fn segment_crosses(corners: [[f64; 3]; 3], from: [f64; 3], to: [f64; 3]) -> bool {
    let [a, b, c] = corners;
    if side_of_plane(corners, from) * side_of_plane(corners, to) != -1 {
        return false;
    }
    let sides = [
        side_of_plane([from, to, b], c),
        side_of_plane([from, to, c], a),
        side_of_plane([from, to, a], b),
    ];
    // Three zeros are possible only after underflow: a triangle without area has failed above.
    !is_mixed(sides) && sides != [0; 3]
}

/// Whether the point lies on the triangle, which may have no area.
fn is_on(corners: [[f64; 3]; 3], point: [f64; 3]) -> bool {
    let in_box = (0..3).all(|k| {
        let [a, b, c] = corners.map(|corner| corner[k]);
        a.min(b).min(c) <= point[k] && point[k] <= a.max(b).max(c)
    });
    let in_projection = |x: usize, y: usize| {
        let flat = |p: [f64; 3]| [p[x], p[y]];
        let ([a, b, c], p) = (corners.map(flat), flat(point));
        !is_mixed([orientation(b, c, p), orientation(c, a, p), orientation(a, b, p)])
    };
    in_box
        && side_of_plane(corners, point) == 0
        && in_projection(0, 1)
        && in_projection(1, 2)
        && in_projection(2, 0)
}

/// Whether the signs contain both 1 and -1.
fn is_mixed(signs: [i32; 3]) -> bool {
    signs.contains(&1) && signs.contains(&-1)
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

/// Sign of the area of the triangle `a b p`: 1 if counterclockwise, 0 if the points lie on a line.
fn orientation(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> i32 {
    let [a, b, p] = [a, b, p].map(|[x, y]| Coord { x, y });
    sign(orient2d(a, b, p))
}

/// Returns the side of a triangle's plane on which the point lies. 1 if the corners appear
/// clockwise from the point, -1 if counterclockwise. 0 in the plane, or for a triangle without
/// area.
fn side_of_plane(corners: [[f64; 3]; 3], point: [f64; 3]) -> i32 {
    let [a, b, c, p] =
        [corners[0], corners[1], corners[2], point].map(|[x, y, z]| Coord3D { x, y, z });
    sign(orient3d(a, b, c, p))
}

/// Returns the sign of the area of `a b p`, or if it is zero the sign after the move of the tie
/// rule. The area changes by e (a_y - b_y) + e^2 (b_x - a_x), halved. Zero only for equal points.
fn or_tie(side: i32, a: [f64; 2], b: [f64; 2]) -> i32 {
    match (side, sign(a[1] - b[1])) {
        (0, 0) => sign(b[0] - a[0]),
        (0, tie) => tie,
        (decided, _) => decided,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

    /// The faces of a cube from -1 to 1, split along diagonals.
    fn cube() -> Vec<[[f64; 3]; 3]> {
        let corner = |i: usize| [0, 1, 2].map(|k| f64::from((i >> k & 1) as u8) * 2.0 - 1.0);
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let halves = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]];
        quads.into_iter().flat_map(halves).map(|t| t.map(corner)).collect()
    }

    /// Every lattice point in and around a cube, where all ties occur.
    #[test]
    fn parity_is_right_on_a_lattice_in_every_direction() {
        let cube = cube();
        for i in 0..343 {
            let point = [i % 7, i / 7 % 7, i / 49].map(|k| f64::from(k) * 0.5 - 1.5);
            let far = point.iter().fold(0.0, |far: f64, x| far.max(x.abs()));
            for axes in AXES {
                for upward in [false, true] {
                    let meetings = cube.iter().map(|t| half_line(*t, point, axes, upward));
                    let meetings: Vec<_> = meetings.collect();
                    let starts = meetings.contains(&HalfLineIntersection::Starts);
                    assert_eq!(starts, far == 1.0, "{point:?} {axes:?} {upward}");
                    let crossed =
                        meetings.iter().filter(|&&m| m == HalfLineIntersection::Crosses).count();
                    assert!(starts || crossed % 2 == usize::from(far < 1.0), "{point:?} {axes:?}");
                }
            }
        }
    }

    #[test]
    fn a_segment_is_open() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let crosses = |from, to| segment_crosses(triangle, from, to);
        assert!(crosses([0.2, 0.2, 1.0], [0.2, 0.2, -1.0]));
        // Through a corner and along an edge's plane.
        assert!(crosses([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]));
        assert!(!crosses([0.2, 0.2, 1.0], [0.2, 0.2, 0.0]));
        // Both ends lie above the plane. No product underflows here.
        assert!(!crosses([0.2, 0.2, 1.0], [0.2, 0.2, 1e-300]));
        assert!(!crosses([0.6, 0.6, 1.0], [0.6, 0.6, -1.0]));
        assert!(!crosses([-1.0, 0.2, 0.0], [2.0, 0.2, 0.0]));
    }

    #[test]
    fn a_point_on_a_segment_shaped_triangle_is_found() {
        let needle = [[0.0, 0.0, 0.0], [2.0, 2.0, 2.0], [1.0, 1.0, 1.0]];
        assert!(is_on(needle, [0.5; 3]));
        assert!(!is_on(needle, [0.5, 0.5, 0.25]) && !is_on(needle, [2.5; 3]));
    }

    /// The tie rule moves the half-line by (e, e^2). A move by small numbers gives the same.
    #[test]
    fn ties_are_decided_as_if_the_half_line_were_moved() {
        for i in 0..343 {
            let point = [i % 7, i / 7 % 7, i / 49].map(|k| f64::from(k) * 0.5 - 1.5);
            for (axes, upward) in AXES.into_iter().flat_map(|a| [(a, false), (a, true)]) {
                let mut moved = point;
                moved[axes[0]] += 1e-3;
                moved[axes[1]] += 1e-6;
                for [a, b, c] in cube() {
                    let found = half_line([a, b, c], point, axes, upward);
                    // The order of the corners does not matter.
                    for corners in [[b, c, a], [c, a, b], [b, a, c], [c, b, a], [a, c, b]] {
                        assert_eq!(half_line(corners, point, axes, upward), found);
                    }
                    if found != HalfLineIntersection::Starts {
                        let expected = half_line([a, b, c], moved, axes, upward);
                        assert_eq!(found, expected, "{:?} {point:?} {axes:?}", [a, b, c]);
                    }
                }
            }
        }
    }

    #[test]
    fn a_half_line_crosses_only_what_lies_in_its_direction() {
        let triangle = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        for (z, upward, expected) in [
            (0.0, true, HalfLineIntersection::Crosses),
            (0.0, false, HalfLineIntersection::Misses),
            (2.0, true, HalfLineIntersection::Misses),
            (2.0, false, HalfLineIntersection::Crosses),
        ] {
            assert_eq!(half_line(triangle, [0.25, 0.25, z], AXES[0], upward), expected);
        }
    }
}
