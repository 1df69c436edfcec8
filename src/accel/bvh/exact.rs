//! The decision: does a ray meet a triangle. Exact on the sheared vertices, so that what shares an
//! edge or a vertex leaves no gap.
//!
//! Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1): vertices are
//! taken relative to the ray's origin and sheared along its dominant axis in f32, which moves
//! coordinate k of a vertex by at most u(2|A_k| + 4|S_k||A_z|) <= 6u max|v - o| (u = 2^-24), the
//! same way in every triangle that shares it. The three edge functions of the sheared points are
//! decided exactly: in f64 the product of two f32 is exact, and the difference of two exact products
//! has the exact sign.

use super::query::Lane;
use crate::ray::Rays;

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

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleHit {
    /// Ray parameter.
    pub t: f64,
    /// Weight of the second corner.
    pub u: f64,
    /// Weight of the third corner.
    pub v: f64,
}

/// Where the ray meets a triangle, edges and corners included; none for a triangle that the shear
/// leaves without area. Any t.
///
/// t is that of the triangle's plane in f64 (error of some 1e-15 of the coordinates over the sine of
/// the angle between ray and plane), kept within the corners' depths, where a ray almost in the
/// plane would leave them.
#[inline(always)]
pub fn hit(lane: &Lane, ray: &Ray64, corners: [[f32; 3]; 3]) -> Option<TriangleHit> {
    let [a, b, c] = corners.map(|v| lane.sheared(v).map(f64::from));
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    let det = u + v + w;
    if !inside || det == 0.0 {
        return None;
    }
    let depths = [a[2], b[2], c[2]].map(|z| z / ray.along);
    let (nearest, farthest) =
        (depths[0].min(depths[1]).min(depths[2]), depths[0].max(depths[1]).max(depths[2]));
    let [p, q, r] = corners.map(|x| x.map(f64::from));
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (e1, e2) = (sub(q, p), sub(r, p));
    let normal = [
        e1[1] * e2[2] - e1[2] * e2[1],
        e1[2] * e2[0] - e1[0] * e2[2],
        e1[0] * e2[1] - e1[1] * e2[0],
    ];
    let plane = dot(normal, sub(p, ray.origin)) / dot(normal, ray.direction);
    let mean = (u * depths[0] + v * depths[1] + w * depths[2]) / det;
    // A NaN is no t; `max` and `min` would take the other operand.
    let t = if plane.is_nan() { mean } else { plane }.max(nearest).min(farthest);
    Some(TriangleHit { t, u: v / det, v: w / det })
}
