//! Splits polygons into triangles.
//!
//! Quads are split into 0-1-2 and 0-2-3, whatever their shape. A larger polygon is projected along
//! the coordinate axis of the largest component of its Newell normal, the sum of the cross products
//! of consecutive corners. This keeps convexity and orientation. Convex polygons become a fan from
//! their first corner. The others are split by ear clipping.

use crate::math::{cross, sub};

/// Maximum number of corners of a polygon that is not convex: ear clipping takes quadratic time.
pub(super) const MAX_CONCAVE: usize = 1 << 14;

/// Splits the polygon `points` into `triangles` of corner indices. Returns false, without
/// triangles, if the polygon is not convex and has more than [`MAX_CONCAVE`] corners.
pub(super) fn split(points: &[[f64; 3]], triangles: &mut Vec<[u32; 3]>) -> bool {
    triangles.clear();
    let count = points.len() as u32;
    let flat = flatten(points);
    if count <= 4 || is_convex(&flat) {
        triangles.extend((1..count.saturating_sub(1)).map(|i| [0, i, i + 1]));
        return true;
    }
    if points.len() > MAX_CONCAVE {
        return false;
    }
    clip_ears(&flat, triangles);
    true
}

/// Projects the polygon to a plane of two coordinates, so that it is counter-clockwise.
fn flatten(points: &[[f64; 3]]) -> Vec<[f64; 2]> {
    // Relative to the first corner: large map coordinates would cancel in the products.
    let Some(&origin) = points.first() else {
        return Vec::new();
    };
    let local: Vec<[f64; 3]> = points.iter().map(|p| sub(*p, origin)).collect();
    let mut normal = [0.0; 3];
    for (i, &point) in local.iter().enumerate() {
        let next = local[(i + 1) % local.len()];
        let part = cross(point, next);
        normal = [normal[0] + part[0], normal[1] + part[1], normal[2] + part[2]];
    }
    let size = normal.map(f64::abs);
    let axis = if size[0] > size[1] && size[0] > size[2] {
        0
    } else if size[1] > size[2] {
        1
    } else {
        2
    };
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let flip = normal[axis] < 0.0;
    local.iter().map(|p| if flip { [p[v], p[u]] } else { [p[u], p[v]] }).collect()
}

/// Returns twice the signed area of a triangle, positive if it is counter-clockwise.
#[inline]
fn area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns true if no corner turns right and the fan from the first corner never turns back. The
/// second test is needed: all corners of a pentagram turn left, but its fan turns back.
fn is_convex(flat: &[[f64; 2]]) -> bool {
    let n = flat.len();
    let corner = |i: usize| [flat[i], flat[(i + 1) % n], flat[(i + 2) % n]];
    // Written so that a polygon with NaN is not convex.
    (0..n).all(|i| area(corner(i)) >= 0.0)
        && (1..n - 1).all(|i| area([flat[0], flat[i], flat[i + 1]]) >= 0.0)
}

/// Splits a counter-clockwise polygon by ear clipping.
fn clip_ears(flat: &[[f64; 2]], triangles: &mut Vec<[u32; 3]>) {
    let mut left: Vec<u32> = (0..flat.len() as u32).collect();
    let mut at = 0;
    while left.len() > 3 {
        let n = left.len();
        let ear = (0..n).map(|step| (at + step) % n).find(|&i| is_ear(flat, &left, i));
        // A polygon that crosses itself may have no ear. Clip a corner anyway, so that the loop
        // ends.
        let ear = ear.unwrap_or(at % n);
        triangles.push([left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]]);
        left.remove(ear);
        // Skipping a corner keeps the triangles from becoming a fan of slivers.
        at = (ear + 1) % left.len();
    }
    triangles.push([left[0], left[1], left[2]]);
}

/// Returns true if corner `i` of the polygon `left` turns left and its triangle contains no other
/// corner.
fn is_ear(flat: &[[f64; 2]], left: &[u32], i: usize) -> bool {
    let n = left.len();
    let [a, b, c] = [(i + n - 1) % n, i, (i + 1) % n].map(|k| flat[left[k] as usize]);
    if area([a, b, c]) <= 0.0 {
        return false;
    }
    left.iter().all(|&k| {
        let p = flat[k as usize];
        // Corners that coincide with a corner of the ear do not block it: seams that join holes
        // have such corners.
        let outside = area([a, b, p]) < 0.0 || area([b, c, p]) < 0.0 || area([c, a, p]) < 0.0;
        outside || p == a || p == b || p == c
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn areas(flat: &[[f64; 2]], triangles: &[[u32; 3]]) -> Vec<f64> {
        triangles.iter().map(|t| area(t.map(|i| flat[i as usize])) / 2.0).collect()
    }

    fn check(flat: &[[f64; 2]], expected_area: f64) {
        for rotate in 0..flat.len() {
            let mut flat = flat.to_vec();
            flat.rotate_left(rotate);
            let mut triangles = Vec::new();
            // A tilted plane far from the origin.
            let points: Vec<[f64; 3]> =
                flat.iter().map(|p| [p[0] + 1e6, p[1] - 2e6, 0.5 * p[0] - p[1]]).collect();
            assert!(split(&points, &mut triangles));
            assert_eq!(triangles.len(), flat.len() - 2);
            let areas = areas(&flat, &triangles);
            assert!(areas.iter().all(|a| *a >= 0.0), "{rotate}: {areas:?}");
            let sum: f64 = areas.iter().sum();
            assert!((sum - expected_area).abs() < 1e-9, "{rotate}: {sum} {expected_area}");
        }
    }

    #[test]
    fn convex_polygons_fan_from_the_first_corner() {
        let hexagon = [[2., 0.], [1., 2.], [-1., 2.], [-2., 0.], [-1., -2.], [1., -2.]];
        let points = hexagon.map(|p| [p[0], 0.0, p[1]]);
        let mut triangles = Vec::new();
        assert!(split(&points, &mut triangles));
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
        check(&hexagon, 12.0);
    }

    #[test]
    fn concave_polygons_keep_their_area_and_orientation() {
        check(&[[0., 0.], [4., 0.], [4., 4.], [2., 1.], [0., 4.]], 10.0);
        // A comb.
        check(
            &[
                [0., 0.],
                [7., 0.],
                [7., 3.],
                [6., 1.],
                [5., 3.],
                [4., 1.],
                [3., 3.],
                [2., 1.],
                [1., 3.],
            ],
            13.5,
        );
        // A square with a square hole, joined by a seam.
        check(
            &[
                [0., 0.],
                [4., 0.],
                [4., 4.],
                [0., 4.],
                [0., 0.],
                [1., 1.],
                [1., 3.],
                [3., 3.],
                [3., 1.],
                [1., 1.],
            ],
            12.0,
        );
    }

    #[test]
    fn degenerate_and_self_crossing_polygons_still_give_n_minus_2_triangles() {
        let mut triangles = Vec::new();
        let star: Vec<[f64; 3]> = [0, 2, 4, 1, 3]
            .iter()
            .map(|i| (*i as f64 * 1.2566370614359172).sin_cos())
            .map(|(y, x)| [x, y, 0.0])
            .collect();
        for points in [star, vec![[0.0; 3]; 7], vec![[f64::NAN; 3]; 6], vec![[f64::INFINITY; 3]; 5]]
        {
            assert!(split(&points, &mut triangles));
            assert_eq!(triangles.len(), points.len() - 2);
        }
    }

    #[test]
    fn a_huge_concave_polygon_is_refused() {
        let mut points: Vec<[f64; 3]> = (0..MAX_CONCAVE + 2)
            .map(|i| i as f64 / (MAX_CONCAVE + 2) as f64 * std::f64::consts::TAU)
            .map(|t| [t.cos(), t.sin(), 0.0])
            .collect();
        let mut triangles = Vec::new();
        assert!(split(&points, &mut triangles));
        points[7] = [0.0; 3];
        assert!(!split(&points, &mut triangles));
    }
}
