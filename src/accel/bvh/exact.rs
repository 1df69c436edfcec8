//! The decision: does a ray meet a triangle. Exact on the sheared vertices, so that what shares an
//! edge or a vertex leaves no gap.
//!
//! Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1): vertices are
//! taken relative to the ray's origin and sheared along its dominant axis in f32, which moves
//! coordinate k of a vertex by at most u(2|A_k| + 4|S_k||A_z|) <= 6u max|v - o| (u = 2^-24), the
//! same way in every triangle that shares it. The three edge functions of the sheared points are
//! decided exactly: in f64 the product of two f32 is exact, and the difference of two exact products
//! has the exact sign.

use super::node::Block;
use super::query::Lane;
use crate::ray::Rays;

/// How far, relatively, a depth may lie outside of the corners' depths: the rounding of f64, which
/// takes a plane across the dominant axis out of them, and much less than boxes are widened by.
pub const DEPTH_SLACK: f64 = 1.0 / (1u64 << 40) as f64;

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

    /// Where a ray meets it; NaN or infinite for a ray along it.
    #[inline(always)]
    pub fn t(&self, [ox, oy, oz]: [f64; 3], [dx, dy, dz]: [f64; 3]) -> f64 {
        let ([px, py, pz], [nx, ny, nz]) = (self.point, self.normal);
        let above = nx * (px - ox) + ny * (py - oy) + nz * (pz - oz);
        above / (nx * dx + ny * dy + nz * dz)
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

    /// Whether the ray's line meets the triangle, edges and corners included; not if the shear leaves
    /// it without area. NaN, of a vertex too far away for f32, is outside.
    #[inline(always)]
    pub fn inside(&self) -> bool {
        let [u, v, w] = self.edges;
        let (left, right) =
            ((u >= 0.0) & (v >= 0.0) & (w >= 0.0), (u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        left ^ right
    }

    /// The ray parameter of a triangle that the line meets: that of the triangle's plane in f64
    /// (error of some 1e-15 of the coordinates over the sine of the angle between ray and plane),
    /// kept within the corners' depths, which a ray almost in the plane would leave.
    #[inline(always)]
    pub fn t(&self, ray: &Ray64, corners: [[f32; 3]; 3]) -> f64 {
        let t = Plane::new(corners).t(ray.origin, ray.direction);
        let [a, b, c] = self.depths;
        let (least, most) = (f64::from(min3(a, b, c)), f64::from(max3(a, b, c)));
        let depth = t * ray.along;
        let slack = depth.abs() * DEPTH_SLACK;
        // On this side of the comparisons: beside an infinite depth, of a ray along the plane, it makes a NaN.
        if depth + slack >= least && depth - slack <= most {
            t
        } else {
            self.clamped(ray, depth, least, most)
        }
    }

    #[cold]
    fn clamped(&self, ray: &Ray64, depth: f64, least: f64, most: f64) -> f64 {
        let [u, v, w] = self.edges;
        let [a, b, c] = self.depths.map(f64::from);
        // A plane along the ray tells nothing: where the line passes the sheared triangle.
        let mean = (u * a + v * b + w * c) / (u + v + w);
        let depth = if depth.is_finite() { depth } else { mean };
        depth.max(least).min(most) / ray.along
    }
}
