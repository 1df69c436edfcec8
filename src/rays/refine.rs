//! Values of hits in f64, 16 at a time.

use super::arrays;
use super::batch::RayBatch;
use super::rounded::Doubles;
use super::scene::RayScene;
use crate::geometry::clamp_barycentrics;
use crate::math::{cross, dot, sub};
use crate::ray::LANES;
use crate::simd::{self, Isa, Kernel};

/// One vector of doubles per lane.
type Doubles3 = [Doubles; 3];

/// Up to 16 hits of any rays.
pub(super) struct HitBatch {
    pub count: usize,
    /// Indices of the rays.
    pub rays: [usize; LANES],
    /// Scene-wide indices of the triangles.
    pub primitives: [u32; LANES],
    /// What the tree found. It is kept where the ray runs in the plane of the triangle.
    pub t: Doubles,
    pub uv: [Doubles; 2],
}

impl HitBatch {
    pub const EMPTY: Self = Self {
        count: 0,
        rays: [0; LANES],
        primitives: [0; LANES],
        t: [0.0; LANES],
        uv: [[0.0; LANES]; 2],
    };

    /// Adds a hit. There is room for 16.
    #[inline(always)]
    pub fn push(&mut self, ray: usize, primitive: u32, t: f64, [u, v]: [f64; 2]) {
        let i = self.count % LANES;
        (self.rays[i], self.primitives[i], self.t[i]) = (ray, primitive, t);
        (self.uv[0][i], self.uv[1][i]) = (u, v);
        self.count = i + 1;
    }
}

/// Values of hits, computed in f64.
pub(super) struct Refined {
    /// Ray parameters.
    pub t: Doubles,
    /// Weights of the second and third corner.
    pub uv: [Doubles; 2],
    /// Unit normals.
    normals: Doubles3,
}

impl Refined {
    /// Barycentric weights of hit `i`.
    pub fn weights(&self, i: usize) -> [f64; 2] {
        [self.uv[0][i], self.uv[1][i]]
    }

    /// Unit normal of hit `i`.
    pub fn normal(&self, i: usize) -> [f64; 3] {
        self.normals.map(|axis| axis[i])
    }
}

impl RayScene {
    /// Computes hits in f64, from the caller's arrays.
    pub(super) fn refine(&self, rays: &RayBatch, hits: &HitBatch) -> Refined {
        let mut corners = [[[1.0; LANES]; 3]; 3];
        // All faces before the first vertex, so that the reads do not wait for each other.
        let mut faces = [(0, [None; 3]); LANES];
        for (face, &primitive) in faces.iter_mut().zip(&hits.primitives[..hits.count]) {
            let (mesh, index) = self.place(primitive);
            *face = (mesh, self.meshes[mesh].faces().get(index));
        }
        for (i, (mesh, face)) in faces.iter().take(hits.count).enumerate() {
            let positions = arrays::positions(self.meshes[*mesh].as_ref(), *face);
            for (corner, position) in corners.iter_mut().zip(positions) {
                (corner[0][i], corner[1][i], corner[2][i]) = position.into();
            }
        }
        simd::dispatch(Isa::detect(), Refine { rays, hits, corners: &corners })
    }
}

/// The work of [`RayScene::refine`].
struct Refine<'a> {
    rays: &'a RayBatch<'a>,
    hits: &'a HitBatch,
    /// By corner.
    corners: &'a [Doubles3; 3],
}

impl Kernel for Refine<'_> {
    type Output = Refined;

    /// Moeller and Trumbore 1997, eq. 6, as [`crate::geometry::refine_triangle`].
    #[inline(always)]
    fn run(self) -> Refined {
        let Self { rays, hits, corners: [v0, v1, v2] } = self;
        let (mut from, mut direction) = ([[0.0; LANES]; 3], [[1.0; LANES]; 3]);
        let (mut tnear, mut tfar) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..hits.count.min(LANES) {
            let (o, d) = rays.line(hits.rays[i]);
            for axis in 0..3 {
                from[axis][i] = o[axis];
                direction[axis][i] = d[axis];
            }
            (tnear[i], tfar[i]) = rays.limits(hits.rays[i]);
        }
        let mut out =
            Refined { t: [0.0; LANES], uv: [[0.0; LANES]; 2], normals: [[0.0; LANES]; 3] };
        for i in 0..LANES {
            let a = of_lane(v0, i);
            let (e1, e2) = (sub(of_lane(v1, i), a), sub(of_lane(v2, i), a));
            let (to_v0, d) = (sub(a, of_lane(&from, i)), of_lane(&direction, i));
            let normal = cross(e1, e2);
            let inverse = 1.0 / dot(normal, d);
            let r = cross(to_v0, d);
            let t = dot(normal, to_v0) * inverse;
            let is_exact = t.abs() < f64::INFINITY;
            let u = if is_exact { dot(r, e2) * inverse } else { hits.uv[0][i] };
            let v = if is_exact { -dot(r, e1) * inverse } else { hits.uv[1][i] };
            let t = if is_exact { t } else { hits.t[i] };
            (out.uv[0][i], out.uv[1][i]) = clamp_barycentrics(u, v);
            out.t[i] = t.max(tnear[i]).min(tfar[i]);
            let shrink = 1.0 / dot(normal, normal).sqrt();
            for axis in 0..3 {
                out.normals[axis][i] = normal[axis] * shrink;
            }
        }
        out
    }
}

#[inline(always)]
fn of_lane([x, y, z]: &Doubles3, i: usize) -> [f64; 3] {
    [x[i], y[i], z[i]]
}
