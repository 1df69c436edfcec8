//! The exact decision whether a ray hits a triangle. Triangles that share an edge or a vertex leave
//! no gap.
//!
//! The test is that of Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT
//! 2(1). The vertices are taken relative to the ray's origin and sheared along its dominant axis,
//! in f32. With A = v - o, S the shear and u = 2^-24, this moves coordinate k of a vertex by at
//! most u(2|A_k| + 4|S_k||A_z|) <= 6u max|v - o|. It moves a shared vertex in the same way in every
//! triangle.
//!
//! The signs of the three edge functions of the sheared points are exact. In f64 the product of two
//! f32 is exact, and the difference of two exact products has the exact sign.

use super::node::Block;
use super::query::Lane;
use crate::geometry::{NEAR_START, is_after_start};
use crate::ray::Rays;

/// How far a hit's depth may lie outside the depths of the corners, as a fraction of the hit's
/// depth: u = 2^-24.
///
/// Rounding moves the depths of the corners by that much. Without the slack, a plane normal to the
/// dominant axis could lie outside the rounded depths of its own corners.
pub const DEPTH_SLACK: f64 = 0.5 * f32::EPSILON as f64;

/// How far a hit may lie outside its triangle's box, relative to max|v - o| over the corners: 64u
/// (u = 2^-24).
///
/// Boxes are widened by more than that during traversal. The smallest normal f32 is added, for
/// underflow.
///
/// Why 64u suffices:
/// - The shear moves a vertex by e, at most 6u max|v - o| in each coordinate. So at the depth where
///   the ray's line passes through the sheared triangle, the line is within 6u max|v - o| of the
///   triangle.
/// - To reach the plane of the triangle, with normal n, the hit moves on by e.n / d.n along the
///   dominant axis. That is at most 6u max|v - o| times [`STEEP`], unless |d.n| < |n| / [`STEEP`],
///   where |n| is the sum of the magnitudes of n.
/// - Together these are 60u. Only a hit on a plane less steep than [`STEEP`] must be clamped to the
///   box.
pub const BOX_SLACK: f64 = 32.0 * f32::EPSILON as f64;

/// A ray hits a plane steeply if this times |d.n| is at least |n|, where d has magnitude 1 along
/// the dominant axis: see [`BOX_SLACK`].
pub const STEEP: f64 = 9.0;

/// At least the scene's extent, seen from the origin of a ray, divided by the ray's
/// [`box_slack`](super::query::Query::box_slack), which is more than 65u of that extent.
const EXTENT_OF_SLACK: f64 = 1.0 / (65.0 * 0.5 * f32::EPSILON as f64);

/// A ray in f64, with the caller's unscaled direction.
#[derive(Debug, Clone, Copy)]
pub struct Ray64 {
    /// Relative to the scene's origin.
    pub origin: [f64; 3],
    /// Not necessarily of unit length.
    pub direction: [f64; 3],
    /// Component of the direction along the ray's dominant axis.
    dominant_component: f64,
    /// Start of the open segment.
    pub tnear: f64,
    /// End of the open segment.
    pub tfar: f64,
}

impl Ray64 {
    /// Converts ray `i` of a packet, whose dominant axis is `axis`.
    #[inline(always)]
    pub fn new(rays: &Rays, i: usize, axis: usize) -> Self {
        let vector = |v: &[[f32; crate::ray::LANES]; 3]| [0, 1, 2].map(|k| f64::from(v[k][i]));
        let direction = vector(&rays.dir);
        Self {
            origin: vector(&rays.org),
            direction,
            dominant_component: direction[axis],
            tnear: rays.tnear[i].into(),
            tfar: rays.tfar[i].into(),
        }
    }

    /// Whether a hit at `t` is farther from the origin than [`NEAR_START`] of the scene's extent.
    /// Then it lies after the start of the ray. Decides most hits.
    #[inline(always)]
    pub fn is_far(&self, t: f64, lane: &Lane) -> bool {
        let extent = f64::from(lane.value(&lane.query.box_slack)) * EXTENT_OF_SLACK;
        t * self.dominant_component.abs() > NEAR_START * extent
    }

    /// Whether a hit at `t` lies after the start of the ray: see [`is_after_start`]. Not inlined,
    /// because few rays start beside a triangle that they hit.
    #[inline(never)]
    pub fn hit_is_after_start(&self, t: f64, corners: [[f32; 3]; 3]) -> bool {
        let corners = corners.map(|corner| corner.map(f64::from).into());
        is_after_start(corners, self.origin.into(), self.direction.into(), t)
    }
}

/// The plane of a triangle, computed in f64 from the f32 corners.
pub struct TrianglePlane {
    point: [f64; 3],
    normal: [f64; 3],
}

impl TrianglePlane {
    #[inline(always)]
    pub fn new([p, q, r]: [[f32; 3]; 3]) -> Self {
        let (px, py, pz) = (f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let (e1x, e1y, e1z) = (f64::from(q[0]) - px, f64::from(q[1]) - py, f64::from(q[2]) - pz);
        let (e2x, e2y, e2z) = (f64::from(r[0]) - px, f64::from(r[1]) - py, f64::from(r[2]) - pz);
        let normal = [e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x];
        Self { point: [px, py, pz], normal }
    }

    /// Returns t and d.n of a ray's hit with the plane. t is NaN or infinite if the ray is parallel
    /// to the plane.
    #[inline(always)]
    pub fn intersect(&self, [ox, oy, oz]: [f64; 3], [dx, dy, dz]: [f64; 3]) -> (f64, f64) {
        let ([px, py, pz], [nx, ny, nz]) = (self.point, self.normal);
        let above = nx * (px - ox) + ny * (py - oy) + nz * (pz - oz);
        let towards = nx * dx + ny * dy + nz * dz;
        (above / towards, towards)
    }

    /// Returns the sum of the magnitudes of the normal: |n| in [`STEEP`].
    #[inline(always)]
    pub fn normal_l1(&self) -> f64 {
        let [nx, ny, nz] = self.normal;
        nx.abs() + ny.abs() + nz.abs()
    }
}

/// A triangle relative to a ray's origin, sheared so that the ray runs along its dominant axis.
pub struct ShearedTriangle {
    /// Edge functions opposite the first, second and third corner. Only the last operation rounds,
    /// so the signs are exact.
    pub edges: [f64; 3],
    /// Depths of the corners along the dominant axis.
    depths: [f32; 3],
}

#[inline(always)]
fn min3<T: PartialOrd>(a: T, b: T, c: T) -> T {
    let m = if a < b { a } else { b };
    if m < c { m } else { c }
}

#[inline(always)]
fn max3<T: PartialOrd>(a: T, b: T, c: T) -> T {
    let m = if a > b { a } else { b };
    if m > c { m } else { c }
}

/// Returns the smallest and the largest depth of a leaf's triangle along the ray's dominant axis,
/// in the direction of the ray.
#[inline(always)]
pub fn depth_range(lane: &Lane, block: &Block, i: usize) -> (f32, f32) {
    let depth = |k: usize| lane.depth_of(block.vertices[lane.axes[2]][block.corner(k, i)]);
    let (a, b, c) = (depth(0), depth(1), depth(2));
    let (lowest, highest) = (min3(a, b, c), max3(a, b, c));
    if lane.octant >> lane.axes[2] & 1 != 0 { (-highest, -lowest) } else { (lowest, highest) }
}

impl ShearedTriangle {
    /// Shears triangle `i` of a leaf.
    #[inline(always)]
    pub fn new(lane: &Lane, block: &Block, i: usize) -> Self {
        let corner = |k: usize| {
            let v = block.corner(k, i);
            lane.sheared(lane.axes.map(|axis| block.vertices[axis][v]))
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let (ax, ay) = (f64::from(a[0]), f64::from(a[1]));
        let (bx, by) = (f64::from(b[0]), f64::from(b[1]));
        let (cx, cy) = (f64::from(c[0]), f64::from(c[1]));
        let edges = [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax];
        Self { edges, depths: [a[2], b[2], c[2]] }
    }

    /// Whether the ray's line hits the triangle, edges and corners included. False if the sheared
    /// triangle has no area. Also false for NaN, which a vertex too far away for f32 gives.
    #[inline(always)]
    pub fn inside(&self) -> bool {
        let [u, v, w] = self.edges;
        let (left, right) =
            ((u >= 0.0) & (v >= 0.0) & (w >= 0.0), (u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        left ^ right
    }

    /// Returns the ray parameter of the hit. The line must hit the triangle ([`Self::inside`]).
    ///
    /// The ray is intersected with the triangle's plane in f64. The error of t is about 1e-15 of
    /// the coordinates over the sine of the angle between ray and plane.
    ///
    /// t is clamped to the corners' depths and to the triangle's box. A hit of a ray almost in the
    /// plane could otherwise lie outside the box. So every hit lies in every box around the
    /// triangle, and the order of boxes cannot change an answer.
    #[inline(always)]
    pub fn t(&self, ray: &Ray64, corners: [[f32; 3]; 3]) -> f64 {
        let plane = TrianglePlane::new(corners);
        let (t, towards) = plane.intersect(ray.origin, ray.direction);
        let (lowest, highest) = self.depth_range();
        let depth = t * ray.dominant_component;
        let slack = depth.abs() * DEPTH_SLACK;
        // The slack is added to the depth, not to the bounds. If the ray runs along the plane, the
        // depth is infinite. One of the sums is then NaN, so `within` is false.
        let within = (depth + slack >= lowest) & (depth - slack <= highest);
        let steep = STEEP * towards.abs() >= plane.normal_l1() * ray.dominant_component.abs();
        if within & (steep || self.passes_near(depth)) {
            t
        } else {
            self.clamped(ray, t, within, corners)
        }
    }

    /// Whether all corners, and so every hit, lie beyond the ray's origin along the dominant axis.
    #[inline(always)]
    pub fn is_ahead(&self, ray: &Ray64) -> bool {
        let (lowest, highest) = self.depth_range();
        if ray.dominant_component < 0.0 { highest < 0.0 } else { lowest > 0.0 }
    }

    /// Whether the line passes through the sheared triangle at a depth close to `depth`.
    ///
    /// Where it passes through, the line is within 6u max|v - o| of the box. `depth` is close
    /// enough if the hit at `depth` is certainly within [`BOX_SLACK`] of the box.
    #[inline(always)]
    fn passes_near(&self, depth: f64) -> bool {
        let ([u, v, w], [a, b, c]) = (self.edges, self.depths.map(f64::from));
        let ((lowest, highest), weight) = (self.depth_range(), u + v + w);
        let reach = if -lowest > highest { -lowest } else { highest };
        (depth * weight - (u * a + v * b + w * c)).abs() <= 0.5 * BOX_SLACK * reach * weight.abs()
    }

    /// Returns `t` if it is `within` the depths of the corners and lies in the triangle's widened
    /// box. Otherwise `t` is clamped to both.
    #[inline(never)]
    fn clamped(&self, ray: &Ray64, t: f64, within: bool, corners: [[f32; 3]; 3]) -> f64 {
        let WidenedBox { lower, upper } = WidenedBox::new(corners, ray.origin);
        let mut inside = within;
        for axis in 0..3 {
            let at = t * ray.direction[axis];
            inside &= (at >= lower[axis]) & (at <= upper[axis]);
        }
        if inside {
            return t;
        }
        let (lowest, highest) = self.depth_range();
        let (first, last) = (lowest / ray.dominant_component, highest / ray.dominant_component);
        let (mut first, mut last) = (first.min(last), first.max(last));
        for axis in 0..3 {
            let d = ray.direction[axis];
            if d != 0.0 {
                let (lower, upper) = (lower[axis] / d, upper[axis] / d);
                (first, last) = (first.max(lower.min(upper)), last.min(lower.max(upper)));
            }
        }
        // If the ray runs along the plane, t of the plane is not finite. Then take the depth at
        // which the line passes through the sheared triangle.
        let [u, v, w] = self.edges;
        let [a, b, c] = self.depths.map(f64::from);
        let passing = || (u * a + v * b + w * c) / (u + v + w) / ray.dominant_component;
        let t = if t.is_finite() { t } else { passing() };
        t.max(first).min(last)
    }

    /// Returns the smallest and the largest depth of the corners.
    #[inline(always)]
    fn depth_range(&self) -> (f64, f64) {
        let [a, b, c] = self.depths;
        (min3(a, b, c).into(), max3(a, b, c).into())
    }
}

/// A triangle's box relative to a ray's origin, widened by [`BOX_SLACK`] and the smallest normal
/// f32.
struct WidenedBox {
    lower: [f64; 3],
    upper: [f64; 3],
}

impl WidenedBox {
    #[inline(always)]
    fn new([p, q, r]: [[f32; 3]; 3], origin: [f64; 3]) -> Self {
        let (mut lower, mut upper, mut reach) = ([0.0; 3], [0.0; 3], 0.0);
        for axis in 0..3 {
            let (p, q, r) = (p[axis], q[axis], r[axis]);
            lower[axis] = f64::from(min3(p, q, r)) - origin[axis];
            upper[axis] = f64::from(max3(p, q, r)) - origin[axis];
            let farther = if -lower[axis] > upper[axis] { -lower[axis] } else { upper[axis] };
            reach = if farther > reach { farther } else { reach };
        }
        let slack = reach * BOX_SLACK + f64::from(f32::MIN_POSITIVE);
        for axis in 0..3 {
            (lower[axis], upper[axis]) = (lower[axis] - slack, upper[axis] + slack);
        }
        Self { lower, upper }
    }
}

#[cfg(test)]
mod tests {
    use super::super::bounds::Bounds3;
    use super::super::query::Query;
    use super::*;

    /// Shears the triangle `corners` for a ray. Calls `look` with the ray, the sheared triangle and
    /// its depths by [`depth_range`].
    fn shear<T>(
        corners: [[f32; 3]; 3],
        origin: [f32; 3],
        direction: [f32; 3],
        look: impl FnOnce(&Ray64, &ShearedTriangle, (f32, f32)) -> T,
    ) -> T {
        let mut block = Block::EMPTY;
        let mut rays = Rays::EMPTY;
        for axis in 0..3 {
            for k in 0..3 {
                block.vertices[axis][k] = corners[k][axis];
                block.corners[k][0] = k as u8;
            }
            (rays.org[axis][0], rays.dir[axis][0]) = (origin[axis], direction[axis]);
        }
        let query = Query::new(&rays, &Bounds3::from_points(&corners));
        let lane = query.lane(0);
        let ray = Ray64::new(&rays, 0, lane.axes[2]);
        look(&ray, &ShearedTriangle::new(&lane, &block, 0), depth_range(&lane, &block, 0))
    }

    /// The axes in cyclic order, forwards and backwards.
    fn turned(v: [f32; 3], turn: usize) -> [f32; 3] {
        let sign = if turn < 3 { 1.0 } else { -1.0 };
        [0, 1, 2].map(|k| sign * v[(k + turn) % 3])
    }

    const SLOPING: [[f32; 3]; 3] = [[0.0, 0.0, 4.0], [4.0, 0.0, 6.0], [0.0, 4.0, 5.0]];

    #[test]
    fn depths_are_those_of_the_corners_along_the_ray() {
        for turn in 0..6 {
            let corners = SLOPING.map(|v| turned(v, turn));
            let (from, to) = (turned([1.0, 1.0, 1.0], turn), turned([0.25, -0.5, 2.0], turn));
            let (depths, ahead) = shear(corners, from, to, |r, t, d| (d, t.is_ahead(r)));
            assert_eq!((depths, ahead), ((3.0, 5.0), true), "{turn}");
            let back = to.map(|d| -d);
            let (depths, ahead) = shear(corners, from, back, |r, t, d| (d, t.is_ahead(r)));
            assert_eq!((depths, ahead), ((-5.0, -3.0), false), "{turn}");
            // A corner at the depth of the origin is not ahead.
            for depth in [4.0, 6.0] {
                let from = turned([1.0, 1.0, depth], turn);
                assert!(!shear(corners, from, to, |r, t, _| t.is_ahead(r)), "{turn}");
                assert!(!shear(corners, from, back, |r, t, _| t.is_ahead(r)), "{turn}");
            }
        }
    }

    #[test]
    fn a_line_without_area_or_beside_an_edge_is_not_inside() {
        let inside = |corners, x: f32, y: f32| {
            shear(corners, [x, y, 0.0], [0.0, 0.0, 1.0], |_, t, _| t.inside())
        };
        let [a, b, c] = SLOPING;
        for corners in [[a, b, c], [a, c, b]] {
            for (x, y) in [(1.0, 1.0), (0.0, 0.0), (4.0, 0.0), (0.0, 2.0), (2.0, 2.0)] {
                assert!(inside(corners, x, y), "{x} {y}");
            }
            for (x, y) in [(-1e-6, 1.0), (1.0, -1e-6), (2.0, 2.0001), (5.0, -1.0)] {
                assert!(!inside(corners, x, y), "{x} {y}");
            }
        }
        assert!(!inside([a, a, b], 0.0, 0.0) && !inside([a, a, a], 0.0, 0.0));
    }

    /// Hits at up to 16 and down to 2^-30 of the scene's extent, before and behind the origin.
    #[test]
    fn a_far_hit_is_after_the_start() {
        let mut far = [0; 2];
        for turn in 0..6 {
            for offset in [0.0f32, 100.0, 65536.0] {
                let scene = Bounds3::from_points(&[[-4.0; 3], [offset + 8.0; 3]]);
                for exponent in -30..5 {
                    let distance = f64::from(exponent).exp2();
                    let mut rays = Rays::EMPTY;
                    let direction = turned([0.25, -0.5, 2.0], turn);
                    for axis in 0..3 {
                        (rays.org[axis][0], rays.dir[axis][0]) = (offset, direction[axis]);
                    }
                    let query = Query::new(&rays, &scene);
                    let lane = query.lane(0);
                    let ray = Ray64::new(&rays, 0, lane.axes[2]);
                    let corners = SLOPING.map(|v| turned(v, turn).map(|x| x + offset));
                    for t in [distance, -distance] {
                        let is_far = ray.is_far(t, &lane);
                        assert!(!is_far || ray.hit_is_after_start(t, corners), "{turn} {t}");
                        far[usize::from(t < 0.0)] += usize::from(is_far);
                    }
                    // 2 t is the depth; the corners are at most offset + 12 from the origin.
                    let beyond = 2.0 * distance > NEAR_START * f64::from(offset + 13.0);
                    assert_eq!(ray.is_far(distance, &lane), beyond, "{turn} {offset} {distance}");
                }
            }
        }
        assert!(far[0] > 0 && far[1] == 0);
    }

    #[test]
    fn t_of_a_steep_ray_is_that_of_the_plane() {
        for turn in 0..6 {
            for length in [1.0, 0.125, 8.0] {
                let corners = SLOPING.map(|v| turned(v, turn));
                let direction = turned([0.0, 0.0, length], turn);
                let t = |r: &Ray64, t: &ShearedTriangle, _| (t.inside(), t.t(r, corners));
                let (inside, t) = shear(corners, turned([1.0, 2.0, -1.0], turn), direction, t);
                assert_eq!((inside, t), (true, 6.0 / f64::from(length)), "{turn}");
            }
        }
    }

    /// The depths of the corners are rounded to f32. The plane's t is more exact, and stays.
    #[test]
    fn t_of_a_plane_across_the_ray_is_not_rounded_to_the_depths_of_the_corners() {
        let (mut up, mut down) = (0, 0);
        for step in 1..40u8 {
            let start = f32::from(step) / 41.0;
            let exact = 5.0 - f64::from(start);
            for (turn, length) in (0..6).flat_map(|turn| [1.0, 0.25, -4.0].map(|l| (turn, l))) {
                let corners = [[-1.0, -1.0, 5.0], [2.0, -1.0, 5.0], [0.0, 3.0, 5.0]];
                let corners = corners.map(|v| turned(v, turn));
                let (from, to) =
                    (turned([0.0, 0.0, start], turn), turned([0.0, 0.0, length], turn));
                shear(corners, from, to, |ray, triangle, _| {
                    let depth = triangle.t(ray, corners) * ray.dominant_component;
                    assert_eq!(depth.abs(), exact, "{start} {turn} {length}");
                    let (rounded, _) = triangle.depth_range();
                    up += u32::from(rounded.abs() > exact);
                    down += u32::from(rounded.abs() < exact);
                });
            }
        }
        assert!(up > 100 && down > 100, "{up} {down}");
    }

    /// Almost in the plane, rounding moves the plane's t far beyond the triangle. A far origin
    /// makes the shear round. Every hit lies in the widened box, and near the depths of the
    /// corners.
    #[test]
    fn hits_of_grazing_rays_lie_in_the_box_of_the_triangle() {
        let (mut hits, mut moved) = (0, 0);
        for i in 0..6000u32 {
            let noise = |k: u32| {
                let bits = (i * 16 + k).wrapping_mul(0x9e37_79b9);
                (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b) as f32 / 2f32.powi(31) - 1.0
            };
            let flat = 2f32.powi(-(i as i32 % 40));
            let turn = i as usize % 6;
            // All points lie near one plane, which is parallel to no axis.
            let near_plane = |x: f32, y: f32, k: u32| [x, y, 0.3 * x - 0.7 * y + flat * noise(k)];
            let corners = [0, 3, 6].map(|k| near_plane(noise(k), noise(k + 1), k + 2));
            let [a, b, c] = corners;
            let target: [f32; 3] = std::array::from_fn(|k| 0.25 * a[k] + 0.5 * b[k] + 0.25 * c[k]);
            let away = near_plane(7.3, noise(9) * 5.1, 10);
            let scale = if i % 3 == 0 { -3.0 } else { 0.75 };
            let origin = std::array::from_fn(|k| target[k] - away[k]);
            let direction = turned(away.map(|x| x * scale), turn);
            let (corners, origin) = (corners.map(|v| turned(v, turn)), turned(origin, turn));
            shear(corners, origin, direction, |ray, triangle, _| {
                if !triangle.inside() {
                    return;
                }
                hits += 1;
                let t = triangle.t(ray, corners);
                let plane = TrianglePlane::new(corners);
                moved += u32::from(t != plane.intersect(ray.origin, ray.direction).0);
                let farthest = corners.iter().flatten().zip(origin.iter().cycle());
                let reach = farthest
                    .fold(0.0, |far: f64, (v, o)| far.max((f64::from(*v) - f64::from(*o)).abs()));
                for axis in 0..3 {
                    let of_corners = corners.map(|v| f64::from(v[axis]) - ray.origin[axis]);
                    let low = of_corners.into_iter().fold(f64::INFINITY, f64::min);
                    let high = of_corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
                    let (at, slack) = (t * ray.direction[axis], 1.001 * BOX_SLACK * reach);
                    assert!(at >= low - slack && at <= high + slack, "{i}: {at} {low} {high}");
                }
                let (low, high) = triangle.depth_range();
                let depth = t * ray.dominant_component;
                let slack = 1.001 * DEPTH_SLACK * depth.abs();
                assert!(depth >= low - slack && depth <= high + slack, "{i}: {depth}");
            });
        }
        assert!(hits > 2000 && moved > 200, "{hits} {moved}");
    }

    /// In the plane of a narrow triangle, the line crosses the box at a side. There, an error of t
    /// leaves the box within the depths of the corners.
    #[test]
    fn a_hit_beside_the_box_of_a_narrow_triangle_moves_to_the_box() {
        let cases: [([[f32; 3]; 3], [f32; 3]); 4] = [
            (
                [
                    [3.6118023, 3.999046, 4.3324785],
                    [3.9863052, 3.998962, 5.7323728],
                    [3.8114007, 4.0003376, 5.0755134],
                ],
                [1.9, 2.0, 2.5168395],
            ),
            (
                [
                    [3.6278367, 3.997651, 4.399482],
                    [3.9653184, 3.9951446, 5.7962847],
                    [3.836752, 4.002608, 5.2469926],
                ],
                [1.9, 2.0, 2.5512393],
            ),
            (
                [
                    [3.7800047, 3.9989173, 3.378285],
                    [4.133324, 3.9955413, 4.7748423],
                    [3.9766667, 4.002107, 4.1410995],
                ],
                [0.99, 1.0001497, 1.02],
            ),
            (
                [
                    [3.77913, 4.0000277, 3.3798304],
                    [4.1403503, 3.9998364, 4.7796354],
                    [3.991538, 4.000562, 4.2011333],
                ],
                [0.99, 1.0000485, 1.02],
            ),
        ];
        for ((corners, direction), turn) in
            cases.into_iter().flat_map(|c| (0..6).map(move |turn| (c, turn)))
        {
            let corners = corners.map(|v| turned(v, turn));
            shear(corners, [0.0; 3], turned(direction, turn), |ray, triangle, _| {
                assert!(triangle.inside());
                let is_between = |t: f64| {
                    let (low, high) = triangle.depth_range();
                    let depth = t * ray.dominant_component;
                    depth >= low && depth <= high
                };
                let is_in_box = |t: f64| {
                    let reach = corners
                        .iter()
                        .flatten()
                        .fold(0.0, |far: f64, &x| far.max(f64::from(x).abs()));
                    let slack = 1.001 * BOX_SLACK * reach;
                    (0..3).all(|axis| {
                        let at = t * ray.direction[axis];
                        let [a, b, c] = corners.map(|v| f64::from(v[axis]));
                        at >= min3(a, b, c) - slack && at <= max3(a, b, c) + slack
                    })
                };
                let (plane, _) = TrianglePlane::new(corners).intersect(ray.origin, ray.direction);
                assert!(is_between(plane) && !is_in_box(plane), "{plane}");
                let t = triangle.t(ray, corners);
                assert!(is_between(t) && is_in_box(t), "{t} {plane}");
                // It moves no farther than to the side.
                assert!(!is_in_box(t + 0.1 * (plane - t)), "{t} {plane}");
            });
        }
    }

    /// Across the ray, a narrow triangle has little depth. There, an error of t leaves the depths
    /// of the corners within the widened box.
    #[test]
    fn a_hit_outside_the_depths_of_the_corners_moves_to_the_nearer_depth() {
        let cases: [([[f32; 3]; 3], [f32; 3]); 4] = [
            (
                [
                    [3.7719917, 3.3, 5.1989694],
                    [3.8280046, 4.699996, 5.198964],
                    [3.8012023, 4.029935, 5.1989756],
                ],
                [1.9, 2.0, 2.5994847],
            ),
            (
                [
                    [3.5981324, 3.2999938, 5.139388],
                    [4.0018554, 4.6999936, 5.139388],
                    [3.8135977, 4.047138, 5.1394057],
                ],
                [1.9, 2.0, 2.569698],
            ),
            (
                [
                    [3.7222822, 3.2999997, 5.0633807],
                    [3.8777175, 4.7, 5.0633807],
                    [3.8181462, 4.1634417, 5.063381],
                ],
                [1.9, 2.0, 2.5316906],
            ),
            (
                [
                    [3.692786, 3.2999997, 5.009739],
                    [3.907213, 4.7, 5.009739],
                    [3.805248, 4.0342665, 5.0097394],
                ],
                [1.9, 2.0, 2.5048697],
            ),
        ];
        let (mut before, mut beyond) = (0, 0);
        for ((corners, direction), turn) in
            cases.into_iter().flat_map(|c| (0..6).map(move |turn| (c, turn)))
        {
            let corners = corners.map(|v| turned(v, turn));
            shear(corners, [0.0; 3], turned(direction, turn), |ray, triangle, _| {
                assert!(triangle.inside());
                let (low, high) = triangle.depth_range();
                let (plane, _) = TrianglePlane::new(corners).intersect(ray.origin, ray.direction);
                let of_plane = plane * ray.dominant_component;
                let slack = of_plane.abs() * DEPTH_SLACK;
                let nearer = if of_plane + slack < low { low } else { high };
                assert!(nearer == low || of_plane - slack > high, "{of_plane} {low} {high}");
                let depth = triangle.t(ray, corners) * ray.dominant_component;
                assert!((depth - nearer).abs() < 1e-14, "{depth} {nearer} {of_plane}");
                before += u32::from(nearer == low);
                beyond += u32::from(nearer == high);
            });
        }
        assert!(before > 0 && beyond > 0);
    }

    /// Almost in the plane: the plane's t decides.
    #[test]
    fn t_of_a_ray_almost_in_the_plane_lies_within_the_triangle() {
        let corners = [[4.0, -1.0, 0.0], [6.0, 1.0, 0.0], [5.0, 0.5, 1e-9]];
        for length in [1.0, 4.0] {
            let t = shear(corners, [0.0; 3], [length, 0.0, 0.0], |r, t, _| t.t(r, corners));
            assert!((4.0..=6.0).contains(&(t * f64::from(length))), "{t}");
        }
    }

    /// Exactly along the plane, t of the plane is no number, or infinite. The depth at which the
    /// line passes through the sheared triangle decides.
    ///
    /// The corners lie in the plane z = 7x. Rounding alone gives the sheared triangle an area: 1/7
    /// is rounded, so corners at x = 3 and x = 6 move by -4e and -8e along x, with e = 2^-24. Those
    /// at x = 1 and x = 2 do not move.
    #[test]
    fn t_of_a_ray_along_the_plane_is_where_the_line_passes_through_the_sheared_triangle() {
        let e = 0.5 * f32::EPSILON;
        let corner = |x: f32, y: f32| [x, y, 7.0 * x];
        // The line passes through the middle of the edge from x = 1 to x = 2.
        let on_edge = [corner(1.0, -1.0), corner(2.0, 1.0), corner(3.0, 0.5)];
        // Seen from the second origin, the corner at x = 1 moves by 2e. So the sheared corners are
        // (2e, 1), (-4e, -5) and (-8e, 2). The line passes through 8/11, 2/11 and 1/11 of them.
        let through = [corner(1.0, 1.0), corner(3.0, -5.0), corner(6.0, 2.0)];
        let cases = [
            (on_edge, 0.0, 1.5, f64::is_nan as fn(f64) -> bool),
            (through, -1.5 * e, 20.0 / 11.0, f64::is_infinite),
        ];
        for (corners, x, expected, is_unusable) in cases {
            for (turn, length) in (0..6).flat_map(|turn| [1.0, 0.25, -4.0].map(|l| (turn, l))) {
                let direction = turned([length, 0.0, 7.0 * length], turn);
                let origin = turned([x, 0.0, 0.0], turn);
                for order in [[0, 1, 2], [1, 2, 0], [2, 1, 0]] {
                    let corners = order.map(|k: usize| turned(corners[k], turn));
                    shear(corners, origin, direction, |ray, triangle, _| {
                        let plane = TrianglePlane::new(corners);
                        assert!(is_unusable(plane.intersect(ray.origin, ray.direction).0));
                        assert!(triangle.inside(), "{turn} {order:?}");
                        let x = triangle.t(ray, corners) * f64::from(length);
                        assert!((x - expected).abs() < 1e-14, "{turn} {order:?}: {x} {expected}");
                    });
                }
            }
        }
    }

    #[test]
    fn the_sum_of_the_normal_counts_every_axis() {
        let corners = [[0.0; 3], [1.0, 0.0, 2.0], [0.0, 1.0, -3.0]];
        let plane = TrianglePlane::new(corners);
        assert_eq!(plane.normal_l1(), 6.0);
        let reversed = TrianglePlane::new([corners[0], corners[2], corners[1]]);
        assert_eq!(reversed.normal_l1(), 6.0);
    }
}
