//! The decision: does a ray meet a triangle. Exact on the sheared vertices, so that what shares an
//! edge or a vertex leaves no gap.
//!
//! Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1): vertices are
//! taken relative to the ray's origin and sheared along its dominant axis in f32, which moves
//! coordinate k of a vertex by at most u(2|A_k| + 4|S_k||A_z|) <= 6u max|v - o| (u = 2^-24), the
//! same way in every triangle that shares it. The three edge functions of the sheared points are
//! decided exactly: in f64 the product of two f32 is exact, and the difference of two exact
//! products has the exact sign.

use super::node::Block;
use super::query::Lane;
use crate::geometry::is_after_start;
use crate::ray::Rays;

/// How far, relatively, a depth may lie outside of the corners' depths: u = 2^-24, which is what
/// rounding does to these; it takes a plane across the dominant axis out of them.
pub const DEPTH_SLACK: f64 = 0.5 * f32::EPSILON as f64;

/// How far, relative to max|v - o| of its corners, a hit may lie outside of a triangle's box: 64u
/// (u = 2^-24), less than boxes are widened by. The least normal f32 comes on top, for what
/// underflows.
///
/// The shear moves a vertex by e, at most 6u max|v - o| in each coordinate, so at the depth where
/// the line passes the sheared triangle it is within that of the triangle. To the plane, of normal
/// n, it goes on by e.n / d.n along the dominant axis: by at most 6u max|v - o| times [`STEEP`],
/// unless |d.n| is less than a part of |n| (its sum of magnitudes) that large. Together 60u, and
/// only what is less steep has to be kept in the box.
pub const BOX_SLACK: f64 = 32.0 * f32::EPSILON as f64;

/// See [`BOX_SLACK`].
pub const STEEP: f64 = 9.0;

/// A ray in f64, as the caller gave it.
#[derive(Debug, Clone, Copy)]
pub struct Ray64 {
    /// Relative to the scene's origin.
    pub origin: [f64; 3],
    /// Any length.
    pub direction: [f64; 3],
    /// Component of the direction along the dominant axis.
    along: f64,
    /// The open segment.
    pub tnear: f64,
    /// The open segment.
    pub tfar: f64,
}

impl Ray64 {
    /// Ray `i` of a packet, whose dominant axis is `axis`.
    #[inline(always)]
    pub fn new(rays: &Rays, i: usize, axis: usize) -> Self {
        let of = |v: &[[f32; crate::ray::LANES]; 3]| [0, 1, 2].map(|k| f64::from(v[k][i]));
        let direction = of(&rays.dir);
        Self {
            origin: of(&rays.org),
            direction,
            along: direction[axis],
            tnear: rays.tnear[i].into(),
            tfar: rays.tfar[i].into(),
        }
    }

    /// Whether the ray has started before it meets a triangle at `t`: see [`is_after_start`]. Not
    /// inlined: few rays start beside a triangle that they hit.
    #[inline(never)]
    pub fn is_started(&self, t: f64, corners: [[f32; 3]; 3]) -> bool {
        let corners = corners.map(|corner| corner.map(f64::from).into());
        is_after_start(corners, self.origin.into(), self.direction.into(), t)
    }
}

/// The plane of a triangle, from the f32 corners in f64.
pub struct Plane {
    point: [f64; 3],
    normal: [f64; 3],
}

impl Plane {
    /// Through three corners.
    #[inline(always)]
    pub fn new([p, q, r]: [[f32; 3]; 3]) -> Self {
        let (px, py, pz) = (f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let (e1x, e1y, e1z) = (f64::from(q[0]) - px, f64::from(q[1]) - py, f64::from(q[2]) - pz);
        let (e2x, e2y, e2z) = (f64::from(r[0]) - px, f64::from(r[1]) - py, f64::from(r[2]) - pz);
        let normal = [e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x];
        Self { point: [px, py, pz], normal }
    }

    /// Where a ray meets it, NaN or infinite for a ray along it; and d.n.
    #[inline(always)]
    pub fn meet(&self, [ox, oy, oz]: [f64; 3], [dx, dy, dz]: [f64; 3]) -> (f64, f64) {
        let ([px, py, pz], [nx, ny, nz]) = (self.point, self.normal);
        let above = nx * (px - ox) + ny * (py - oy) + nz * (pz - oz);
        let towards = nx * dx + ny * dy + nz * dz;
        (above / towards, towards)
    }

    /// The least |d.n| that is [`STEEP`], times that, for a direction of 1 along its dominant axis.
    #[inline(always)]
    pub fn steep(&self) -> f64 {
        let [nx, ny, nz] = self.normal;
        nx.abs() + ny.abs() + nz.abs()
    }
}

/// A triangle as a ray sees it.
pub struct Sheared {
    /// Edge functions opposite the first, second and third corner: exact but for the last rounding,
    /// so their signs are exact.
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

/// Where a leaf's triangle begins and ends along a ray's dominant axis, in the ray's direction.
#[inline(always)]
pub fn depths(lane: &Lane, block: &Block, i: usize) -> (f32, f32) {
    let depth = |k: usize| lane.depth_of(block.vertices[lane.axes[2]][block.corner(k, i)]);
    let (a, b, c) = (depth(0), depth(1), depth(2));
    let (least, most) = (min3(a, b, c), max3(a, b, c));
    if lane.octant >> lane.axes[2] & 1 != 0 { (-most, -least) } else { (least, most) }
}

impl Sheared {
    /// A leaf's triangle.
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

    /// Whether the ray's line meets the triangle, edges and corners included; not if the shear
    /// leaves it without area. NaN, of a vertex too far away for f32, is outside.
    #[inline(always)]
    pub fn inside(&self) -> bool {
        let [u, v, w] = self.edges;
        let (left, right) =
            ((u >= 0.0) & (v >= 0.0) & (w >= 0.0), (u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        left ^ right
    }

    /// The ray parameter of a triangle that the line meets: that of the triangle's plane in f64
    /// (error of some 1e-15 of the coordinates over the sine of the angle between ray and plane),
    /// kept within the corners' depths and within the triangle's box, which a ray almost in the
    /// plane would leave: so a hit lies in every box around the triangle, and the order of boxes
    /// cannot change an answer.
    #[inline(always)]
    pub fn t(&self, ray: &Ray64, corners: [[f32; 3]; 3]) -> f64 {
        let plane = Plane::new(corners);
        let (t, towards) = plane.meet(ray.origin, ray.direction);
        let (least, most) = self.ends();
        let depth = t * ray.along;
        let slack = depth.abs() * DEPTH_SLACK;
        // On this side of the comparisons: beside an infinite depth, of a ray along the plane, it
        // makes a NaN.
        let within = (depth + slack >= least) & (depth - slack <= most);
        let steep = STEEP * towards.abs() >= plane.steep() * ray.along.abs();
        if within & (steep || self.passes(depth)) { t } else { self.kept(ray, t, within, corners) }
    }

    /// Whether all corners lie beyond the ray's origin along the dominant axis, and so every hit.
    #[inline(always)]
    pub fn is_ahead(&self, ray: &Ray64) -> bool {
        let (least, most) = self.ends();
        if ray.along < 0.0 { most < 0.0 } else { least > 0.0 }
    }

    /// Whether the line passes the sheared triangle, which is within 6u of the box, so close to a
    /// depth that this is within the box as well.
    #[inline(always)]
    fn passes(&self, depth: f64) -> bool {
        let ([u, v, w], [a, b, c]) = (self.edges, self.depths.map(f64::from));
        let ((least, most), weight) = (self.ends(), u + v + w);
        let reach = if -least > most { -least } else { most };
        (depth * weight - (u * a + v * b + w * c)).abs() <= 0.5 * BOX_SLACK * reach * weight.abs()
    }

    /// `t`, kept within the triangle's box, and within the corners' depths unless it is `within`
    /// them.
    #[inline(never)]
    fn kept(&self, ray: &Ray64, t: f64, within: bool, corners: [[f32; 3]; 3]) -> f64 {
        let Around { lower, upper } = Around::new(corners, ray.origin);
        let mut inside = within;
        for axis in 0..3 {
            let at = t * ray.direction[axis];
            inside &= (at >= lower[axis]) & (at <= upper[axis]);
        }
        if inside {
            return t;
        }
        let (least, most) = self.ends();
        let (first, last) = (least / ray.along, most / ray.along);
        let (mut first, mut last) = (first.min(last), first.max(last));
        for axis in 0..3 {
            let d = ray.direction[axis];
            if d != 0.0 {
                let (lower, upper) = (lower[axis] / d, upper[axis] / d);
                (first, last) = (first.max(lower.min(upper)), last.min(lower.max(upper)));
            }
        }
        // Of a ray along the plane, which tells nothing, where its line passes the sheared
        // triangle.
        let [u, v, w] = self.edges;
        let [a, b, c] = self.depths.map(f64::from);
        let passing = || (u * a + v * b + w * c) / (u + v + w) / ray.along;
        let t = if t.is_finite() { t } else { passing() };
        t.max(first).min(last)
    }

    /// The least and the greatest depth of the corners.
    #[inline(always)]
    fn ends(&self) -> (f64, f64) {
        let [a, b, c] = self.depths;
        (min3(a, b, c).into(), max3(a, b, c).into())
    }
}

/// A triangle's box relative to a ray's origin, widened by [`BOX_SLACK`] and the least normal f32.
struct Around {
    lower: [f64; 3],
    upper: [f64; 3],
}

impl Around {
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
