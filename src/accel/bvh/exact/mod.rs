//! The exact decision whether a ray hits a triangle. Triangles that share an edge or a vertex leave
//! no gap.
//!
//! The test is that of Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT
//! 2(1). The vertices are taken relative to the ray's origin and sheared along its dominant axis,
//! in f32. With A = v - o, S the shear and u = 2^-24, this moves coordinate k of a vertex by at
//! most u(2|A_k| + 4|S_k||A_z|) <= 6u max|v - o|. It moves a shared vertex in the same way in every
//! triangle.
//!
//! The ray's origin is not moved. So a ray that starts within that distance of a surface may start
//! on the other side of the moved surface, and miss it.
//!
//! The signs of the three edge functions of the sheared points are exact. In f64 the product of two
//! f32 is exact, and the difference of two exact products has the exact sign.

use super::node::Block;
use super::query::Lane;
use crate::geometry::{NEAR_START, is_after_start};
use crate::math::{cross, dot};
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
/// - Together these are 60u. Only a hit on a plane less steep than [`STEEP`] may be elsewhere, and
///   must be moved to the triangle: see [`ShearedTriangle::t`].
/// - In f64 the plane's normal is off by at most 2^-51 |e1||e2|, for edges e1 and e2 of the
///   triangle. That moves a hit by twice as much times [`STEEP`] max|v - o| / |n|, less than the
///   remaining 4u max|v - o|, unless the triangle is a sliver of [`THIN`].
pub const BOX_SLACK: f64 = 32.0 * f32::EPSILON as f64;

/// A ray hits a plane steeply if this times |d.n| is at least |n|, where d has magnitude 1 along
/// the dominant axis: see [`BOX_SLACK`].
pub const STEEP: f64 = 9.0;

/// A triangle whose |n| is below this times |e1||e2| is too thin for f64: its plane counts as not
/// steep. See [`BOX_SLACK`]; all magnitudes are sums of those of the components.
const THIN: f64 = 0.5 * f32::EPSILON as f64;

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
    edges: [[f64; 3]; 2],
    normal: [f64; 3],
}

impl TrianglePlane {
    #[inline(always)]
    pub fn new([p, q, r]: [[f32; 3]; 3]) -> Self {
        let (px, py, pz) = (f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let (e1x, e1y, e1z) = (f64::from(q[0]) - px, f64::from(q[1]) - py, f64::from(q[2]) - pz);
        let (e2x, e2y, e2z) = (f64::from(r[0]) - px, f64::from(r[1]) - py, f64::from(r[2]) - pz);
        let normal = [e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x];
        Self { point: [px, py, pz], edges: [[e1x, e1y, e1z], [e2x, e2y, e2z]], normal }
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

    /// Returns what [`Self::is_near`] needs: for the second and third corner, the vector whose
    /// product with the way from the first corner to a point of the plane is the point's weight.
    /// Not finite for a triangle without area.
    #[inline(always)]
    pub fn weights(&self) -> [[f64; 3]; 2] {
        let ([e1, e2], n) = (self.edges, self.normal);
        let inverse = 1.0 / dot(n, n);
        [cross(e2, n).map(|x| x * inverse), cross(n, e1).map(|x| x * inverse)]
    }

    /// Whether a ray's point at `t` is within `slack` of the triangle along each axis: of its point
    /// whose weights are those of the ray's point, clamped. False for NaN. May be false beside the
    /// triangle although another point of it is nearer.
    #[inline(always)]
    pub fn is_near(
        &self,
        &[second, third]: &[[f64; 3]; 2],
        ([ox, oy, oz], [dx, dy, dz]): ([f64; 3], [f64; 3]),
        (t, slack): (f64, f64),
    ) -> bool {
        let ([px, py, pz], [e1, e2]) = (self.point, self.edges);
        let way = [t * dx + (ox - px), t * dy + (oy - py), t * dz + (oz - pz)];
        let (v, w) = (dot(second, way), dot(third, way));
        let (v, w) = (if v > 0.0 { v } else { 0.0 }, if w > 0.0 { w } else { 0.0 });
        let sum = v + w;
        let shrink = if sum > 1.0 { 1.0 / sum } else { 1.0 };
        let (v, w) = (v * shrink, w * shrink);
        let off = |k: usize| (way[k] - (v * e1[k] + w * e2[k])).abs();
        (off(0) <= slack) & (off(1) <= slack) & (off(2) <= slack)
    }

    /// Returns the sum of the magnitudes of the normal: |n| in [`STEEP`]. Infinite for a triangle
    /// of [`THIN`], on which no hit is steep.
    #[inline(always)]
    pub fn normal_l1(&self) -> f64 {
        let l1 = |[x, y, z]: [f64; 3]| x.abs() + y.abs() + z.abs();
        let ([e1, e2], normal) = (self.edges, l1(self.normal));
        if normal < THIN * (l1(e1) * l1(e2)) { f64::INFINITY } else { normal }
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

/// Returns the barycentric weights of the second and third corner, from the edge functions of a
/// triangle that is hit.
///
/// They are converted to f32 only after normalisation: edge functions of large coordinates may
/// exceed the range of f32.
#[inline(always)]
pub fn weights_of([u, v, w]: [f64; 3]) -> [f32; 2] {
    let inverse = 1.0 / (u + v + w);
    [(v * inverse) as f32, (w * inverse) as f32]
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
    /// A ray almost in the plane may meet it far from where it passes the triangle. Such a t says
    /// nothing about the order of hits. Then t is that of the weights: of the point at which the
    /// line passes through the sheared triangle. So t names a place that is within 70u max|v - o|
    /// of the triangle along each axis (u = 2^-24), in every case:
    /// - steep planes: see [`BOX_SLACK`];
    /// - the plane's t, if [`TrianglePlane::is_near`]: 64u;
    /// - the t of the weights: 6u, by the shear;
    /// - the plane's t, if it is at most 64u from the t of the weights: 70u.
    ///
    /// At last t is clamped to the corners' depths and to the triangle's box, which the t of the
    /// weights does not leave. So a t that is clamped moves towards that of the weights. Every hit
    /// lies in every box around the triangle, and the order of boxes cannot change an answer.
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

    /// Returns `t` if it is `within` the depths of the corners and names a place near the triangle.
    /// Otherwise returns the t of a place at the triangle: see [`Self::t`].
    #[inline(never)]
    fn clamped(&self, ray: &Ray64, t: f64, within: bool, corners: [[f32; 3]; 3]) -> f64 {
        let plane = TrianglePlane::new(corners);
        let WidenedBox { lower, upper, slack } = WidenedBox::new(corners, ray.origin);
        let near = plane.is_near(&plane.weights(), (ray.origin, ray.direction), (t, slack));
        if within & near {
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
        let [u, v, w] = self.edges;
        let [a, b, c] = self.depths.map(f64::from);
        let depth = (u * a + v * b + w * c) / (u + v + w);
        // False if the ray runs along the plane, as t is not finite.
        let passes = (t * ray.dominant_component - depth).abs() <= slack;
        let t = if near | passes { t } else { depth / ray.dominant_component };
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
    /// How far it is widened.
    slack: f64,
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
        Self { lower, upper, slack }
    }
}

#[cfg(test)]
mod tests;
