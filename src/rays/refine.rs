//! Computes t, weights and normals of found hits in f64, from the caller's vertices, 16 hits at a
//! time.

use super::arrays;
use super::batch::RayBatch;
use super::rounded::Doubles;
use super::scene::RayScene;
use crate::geometry::clamp_barycentrics;
use crate::math::{cross, dot, sub};
use crate::ray::LANES;
use crate::simd::{self, Isa, Kernel};

/// A 3D vector for each lane, by axis.
type Doubles3 = [Doubles; 3];

/// Vertex indices of the faces of up to 16 hits; `None` where one is out of range, because the
/// caller has changed the array.
type FaceBatch = [[Option<u64>; 3]; LANES];

/// A hit that the tree found.
#[derive(Debug, Clone, Copy)]
pub(super) struct FoundHit {
    /// Index of the ray.
    pub ray: usize,
    /// Index of the mesh.
    pub mesh: u32,
    /// Face in the mesh.
    pub face: u32,
    /// Ray parameter, in lengths of the caller's direction. It and `uv` remain where the values in
    /// f64 are undefined: the ray runs in the plane of the triangle.
    pub t: f64,
    /// Weights of the second and third corner.
    pub uv: [f64; 2],
}

/// Values of up to 16 hits, computed in f64. The lanes after the last hit are meaningless.
pub(super) struct Refined {
    /// Ray parameters, within tnear and tfar.
    pub t: Doubles,
    /// Weights of the second and third corner.
    pub uv: [Doubles; 2],
    /// Unit normals; not finite for a triangle without area.
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
    /// Prefetches the face of a hit that [`RayScene::refine`] will read.
    #[inline(always)]
    pub(super) fn prefetch_face(&self, mesh: u32, face: u32) {
        self.meshes[mesh as usize].faces().prefetch(face as usize);
    }

    /// Computes the values of hits in f64, from the caller's arrays. Calls `store` with up to 16
    /// hits and their values, in order.
    pub(super) fn refine(
        &self,
        rays: &RayBatch,
        found: &[FoundHit],
        mut store: impl FnMut(&[FoundHit], &Refined),
    ) {
        // The vertices of a batch are prefetched while the batch before is computed.
        let mut batches = found.chunks(LANES).peekable();
        let mut next = self.faces(batches.peek().copied().unwrap_or_default());
        while let Some(hits) = batches.next() {
            let faces = next;
            next = self.faces(batches.peek().copied().unwrap_or_default());
            let mut corners = [[[1.0; LANES]; 3]; 3];
            for (i, (hit, face)) in hits.iter().zip(faces).enumerate() {
                let positions = arrays::positions(self.meshes[hit.mesh as usize].as_ref(), face);
                for (corner, position) in corners.iter_mut().zip(positions) {
                    (corner[0][i], corner[1][i], corner[2][i]) = position.into();
                }
            }
            let refined = simd::dispatch(Isa::detect(), Refine { rays, hits, corners: &corners });
            store(hits, &refined);
        }
    }

    /// Reads the faces of up to 16 hits, and prefetches their vertices.
    #[inline(always)]
    fn faces(&self, hits: &[FoundHit]) -> FaceBatch {
        let mut faces = [[None; 3]; LANES];
        for (face, hit) in faces.iter_mut().zip(hits) {
            let mesh = &self.meshes[hit.mesh as usize];
            *face = mesh.faces().get(hit.face as usize);
            let vertices = mesh.vertices();
            for vertex in face.iter().flatten() {
                vertices.prefetch(*vertex as usize);
            }
        }
        faces
    }
}

/// The work of [`RayScene::refine`] for up to 16 hits.
struct Refine<'a> {
    rays: &'a RayBatch<'a>,
    hits: &'a [FoundHit],
    /// Corners of the triangles, by number of the corner.
    corners: &'a [Doubles3; 3],
}

impl Kernel for Refine<'_> {
    type Output = Refined;

    /// Moeller and Trumbore 1997, eq. 6, with the operations of
    /// [`crate::geometry::refine_triangle`].
    #[inline(always)]
    fn run(self) -> Refined {
        let Self { rays, hits, corners: [v0, v1, v2] } = self;
        let (mut from, mut direction) = ([[0.0; LANES]; 3], [[1.0; LANES]; 3]);
        let (mut tnear, mut tfar) = ([0.0; LANES], [0.0; LANES]);
        let (mut found_t, mut found_uv) = ([0.0; LANES], [[0.0; LANES]; 2]);
        for (i, hit) in hits.iter().enumerate().take(LANES) {
            let (o, d) = rays.line(hit.ray);
            for axis in 0..3 {
                from[axis][i] = o[axis];
                direction[axis][i] = d[axis];
            }
            (tnear[i], tfar[i]) = rays.limits(hit.ray);
            (found_t[i], found_uv[0][i], found_uv[1][i]) = (hit.t, hit.uv[0], hit.uv[1]);
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
            let is_defined = t.abs() < f64::INFINITY;
            let u = if is_defined { dot(r, e2) * inverse } else { found_uv[0][i] };
            let v = if is_defined { -dot(r, e1) * inverse } else { found_uv[1][i] };
            let t = if is_defined { t } else { found_t[i] };
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
