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
    let mut ears = Ears { flat, clipped: vec![false; flat.len()], harmless: vec![0; flat.len()] };
    let mut left: Vec<u32> = (0..flat.len() as u32).collect();
    let mut at = 0;
    while left.len() > 3 {
        let n = left.len();
        let around = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
        let ear = (0..n).map(|step| (at + step) % n).find(|&i| ears.is_ear(around(i)));
        // A polygon that crosses itself may have no ear. Clip a corner anyway, so that the loop
        // ends.
        let ear = ear.unwrap_or(at % n);
        triangles.push(around(ear));
        ears.clip(around(ear));
        left.remove(ear);
        // Skipping a corner keeps the triangles from becoming a fan of slivers.
        at = (ear + 1) % left.len();
    }
    triangles.push([left[0], left[1], left[2]]);
}

/// The search for ears. It continues where it stopped at a corner, so that all of it takes
/// quadratic time: a corner that does not block an ear never blocks it.
struct Ears<'a> {
    flat: &'a [[f64; 2]],
    /// True for corners that are no longer in the polygon.
    clipped: Vec<bool>,
    /// For each corner, the number of corners, from the first on, that do not block its triangle.
    /// It is [`TURNS_RIGHT`] for a corner that is no ear whatever the others are.
    harmless: Vec<u32>,
}

/// Marks a corner that does not turn left.
const TURNS_RIGHT: u32 = u32::MAX;

impl Ears<'_> {
    /// Returns true if a corner turns left and its triangle contains no other corner. It is given
    /// between the corners before and after it.
    fn is_ear(&mut self, [before, corner, after]: [u32; 3]) -> bool {
        let harmless = &mut self.harmless[corner as usize];
        if *harmless == TURNS_RIGHT {
            return false;
        }
        let [a, b, c] = [before, corner, after].map(|k| self.flat[k as usize]);
        if *harmless == 0 && area([a, b, c]) <= 0.0 {
            *harmless = TURNS_RIGHT;
            return false;
        }
        let first = *harmless as usize;
        for (&p, &clipped) in self.flat[first..].iter().zip(&self.clipped[first..]) {
            // Corners that coincide with a corner of the ear do not block it: seams that join holes
            // have such corners.
            let outside = area([a, b, p]) < 0.0 || area([b, c, p]) < 0.0 || area([c, a, p]) < 0.0;
            if !(clipped || outside || p == a || p == b || p == c) {
                return false;
            }
            *harmless += 1;
        }
        true
    }

    /// Removes a corner. The corners before and after it have new triangles.
    fn clip(&mut self, [before, corner, after]: [u32; 3]) {
        self.clipped[corner as usize] = true;
        self.harmless[before as usize] = 0;
        self.harmless[after as usize] = 0;
    }
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

    /// The triangles are those of a search that compares each corner with all others every time.
    #[test]
    fn the_search_for_ears_finds_the_first_one_every_time() {
        let plain = |flat: &[[f64; 2]]| {
            let (mut left, mut at, mut found) = ((0..flat.len()).collect::<Vec<_>>(), 0, vec![]);
            while left.len() > 3 {
                let n = left.len();
                let around = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
                let is_ear = |i: &usize| {
                    let ear = around(*i).map(|k| flat[k]);
                    let [a, b, c] = ear;
                    let blocks = |&k: &usize| {
                        let p = flat[k];
                        let sides = [[a, b, p], [b, c, p], [c, a, p]];
                        !ear.contains(&p) && sides.iter().all(|side| area(*side) >= 0.0)
                    };
                    area(ear) > 0.0 && !left.iter().any(blocks)
                };
                let ear = (0..n).map(|step| (at + step) % n).find(is_ear).unwrap_or(at % n);
                found.push(around(ear).map(|k| k as u32));
                left.remove(ear);
                at = (ear + 1) % left.len();
            }
            found.push([left[0] as u32, left[1] as u32, left[2] as u32]);
            found
        };
        let mut state = 1u32;
        let mut random = |below: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from((state >> 16) % below)
        };
        // Stars with corners at random distances, and corners on a small grid, which cross each
        // other and coincide.
        for case in 0..400 {
            let n = 5 + case % 37;
            let flat: Vec<[f64; 2]> = (0..n)
                .map(|i| match case % 2 {
                    0 => {
                        let (y, x) =
                            (f64::from(i) * std::f64::consts::TAU / f64::from(n)).sin_cos();
                        let far = 1.0 + random(9);
                        [x * far, y * far]
                    }
                    _ => [random(5), random(5)],
                })
                .collect();
            let mut triangles = Vec::new();
            clip_ears(&flat, &mut triangles);
            assert_eq!(triangles, plain(&flat), "{flat:?}");
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
