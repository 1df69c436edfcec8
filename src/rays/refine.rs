//! Computes t, weights and normals of found hits in f64, from the caller's vertices, 16 hits at a
//! time.
//!
//! Where a ray runs almost in the plane of its triangle, f64 cannot tell where it meets the plane.
//! It may also miss the triangle, whose rounded corners it hits. Then the place that t names is
//! far from the place that the weights name. The weights of the rounded triangle are right in both
//! cases, as the tree decides exactly for a ray alone. So they are taken, and t is that of the
//! point of the ray that is nearest to their place.

use super::arrays;
use super::batch::RayBatch;
use super::further::{above, below};
use super::rounded::{Doubles, Rounded, power_of_two};
use super::scene::RayScene;
use crate::geometry::clamp_barycentrics;
use crate::math::{cross, dot, sub};
use crate::ray::{Coherence, LANES, Mask};
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
    /// Ray parameter of the rounded ray.
    pub t: f32,
    /// Weights of the second and third corner, for the rounded ray and triangle.
    pub uv: [f32; 2],
    /// Whether the weights are those of a ray alone. Among other rays, the tree tells them only to
    /// 1.5e-3.
    pub alone: bool,
}

/// Values of up to 16 hits, computed in f64. The lanes after the last hit are meaningless.
pub(super) struct Refined {
    /// Ray parameters, finite and >= 0, in lengths of the caller's direction.
    pub t: Doubles,
    /// Whether t is within the ray's own limits: tnear < t < tfar, by more than a fraction of t
    /// that the caller names. A tnear of 0 is no limit, as t of an origin on the surface is 0 only
    /// up to rounding.
    pub counts: [bool; LANES],
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

    /// Computes the values of hits in f64, from the caller's arrays. Hits count if they are within
    /// the limits by more than the fraction `margin` of t. Calls `store` with up to 16 hits and
    /// their values, in order.
    pub(super) fn refine(
        &self,
        rays: &RayBatch,
        found: &[FoundHit],
        margin: f64,
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
            let slack = self.rounding_slack();
            let refine = Refine { rays, hits, corners: &corners, slack, margin };
            let (mut refined, agree) = simd::dispatch(Isa::detect(), refine);
            for i in (0..hits.len()).filter(|&i| !agree[i]) {
                let [v0, v1, v2] = corners.each_ref().map(|corner| of_lane(corner, i));
                self.settle(rays, &hits[i], ([v0, v1, v2], slack, margin), (&mut refined, i));
            }
            store(hits, &refined);
        }
    }

    /// Computes the values of hit `i` again, whose t and weights name places far apart.
    #[inline(never)]
    fn settle(
        &self,
        rays: &RayBatch,
        hit: &FoundHit,
        ([v0, v1, v2], slack, margin): ([[f64; 3]; 3], f64, f64),
        (out, i): (&mut Refined, usize),
    ) {
        let (&from, &direction) = rays.line(hit.ray);
        let corners = [sub(v0, from), sub(v1, v0), sub(v2, v0)];
        let (t, u, v) = settled(corners, direction, slack, || self.weights_alone(rays, hit));
        (out.uv[0][i], out.uv[1][i]) = (u, v);
        out.t[i] = t;
        out.counts[i] = counts(t, rays.limits(hit.ray).into(), margin);
    }

    /// The weights that the tree finds for the ray of a hit alone. If it then hits another face at
    /// the same t, the weights are those of the hit.
    fn weights_alone(&self, rays: &RayBatch, hit: &FoundHit) -> [f32; 2] {
        if hit.alone {
            return hit.uv;
        }
        let mut rounded = Rounded::EMPTY;
        let rounding = self.rounding(rays);
        if rounding.and_then(|rounding| rounding.round(hit.ray, &mut rounded)).is_err() {
            return hit.uv;
        }
        let mut alone = Mask::NONE;
        alone.0[0] = rounded.active.0[0];
        // The ray may have been searched on from an earlier hit, which does not count. Ends do not
        // belong to a segment.
        let rays = &mut rounded.packet.rays;
        (rays.tnear[0], rays.tfar[0]) = (below(hit.t), above(hit.t));
        self.accelerator().closest(&alone, &mut rounded.packet, Coherence::Unordered);
        let hits = &rounded.packet.hits;
        if [hits.geom[0], hits.prim[0]] == [hit.mesh, hit.face] {
            [hits.u[0], hits.v[0]]
        } else {
            hit.uv
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
    /// The places of t and of the weights may be this far apart.
    slack: f64,
    /// The fraction of t by which hits that count are within the limits.
    margin: f64,
}

impl Kernel for Refine<'_> {
    /// Also returns whether t and the weights of each hit name about the same place.
    type Output = (Refined, [bool; LANES]);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { rays, hits, corners: [v0, v1, v2], slack, margin } = self;
        let (mut from, mut direction) = ([[0.0; LANES]; 3], [[1.0; LANES]; 3]);
        let (mut tnear, mut tfar) = ([0.0; LANES], [0.0; LANES]);
        for (i, hit) in hits.iter().enumerate().take(LANES) {
            let (o, d) = rays.line(hit.ray);
            for axis in 0..3 {
                from[axis][i] = o[axis];
                direction[axis][i] = d[axis];
            }
            (tnear[i], tfar[i]) = rays.limits(hit.ray);
        }
        let mut out = Refined {
            t: [0.0; LANES],
            counts: [true; LANES],
            uv: [[0.0; LANES]; 2],
            normals: [[0.0; LANES]; 3],
        };
        let mut agree = [true; LANES];
        for i in 0..LANES {
            let a = of_lane(v0, i);
            let corners =
                [sub(a, of_lane(&from, i)), sub(of_lane(v1, i), a), sub(of_lane(v2, i), a)];
            let normal = cross(corners[1], corners[2]);
            let (t, u, v) = meet(corners, normal, of_lane(&direction, i));
            // An infinite product would make t and the weights 0, the first corner.
            let is_finite = dot(normal, of_lane(&direction, i)).abs() < f64::INFINITY;
            agree[i] = is_near(corners, of_lane(&direction, i), (t, u, v), slack) & is_finite;
            (out.uv[0][i], out.uv[1][i]) = (u, v);
            out.t[i] = t.max(0.0);
            out.counts[i] = counts(out.t[i], [tnear[i], tfar[i]], margin);
            let shrink = 1.0 / dot(normal, normal).sqrt();
            for axis in 0..3 {
                out.normals[axis][i] = normal[axis] * shrink;
            }
        }
        (out, agree)
    }
}

/// Whether t is within tnear and tfar: see [`Refined::counts`].
#[inline(always)]
fn counts(t: f64, [tnear, tfar]: [f64; 2], margin: f64) -> bool {
    ((t * (1.0 - margin) > tnear) | (tnear == 0.0)) & (t * (1.0 + margin) < tfar)
}

/// Returns t, u and v where a ray meets the plane of a triangle: Moeller and Trumbore 1997, eq. 6,
/// with the operations of [`crate::geometry::refine_triangle`]. The triangle is the way from the
/// ray's origin to its first corner, and two edges.
#[inline(always)]
fn meet([to_v0, e1, e2]: [[f64; 3]; 3], normal: [f64; 3], d: [f64; 3]) -> (f64, f64, f64) {
    let inverse = 1.0 / dot(normal, d);
    let r = cross(to_v0, d);
    let (u, v) = clamp_barycentrics(dot(r, e2) * inverse, -dot(r, e1) * inverse);
    (dot(normal, to_v0) * inverse, u, v)
}

/// Whether the places of t and of the weights are near to each other. False for NaN.
#[inline(always)]
fn is_near(corners: [[f64; 3]; 3], d: [f64; 3], (t, u, v): (f64, f64, f64), slack: f64) -> bool {
    let [x, y, z] = sub(d.map(|x| t * x), point(corners, u, v));
    (x.abs() <= slack) & (y.abs() <= slack) & (z.abs() <= slack)
}

/// Returns t, u and v of a ray for which [`is_near`] is false. The direction is scaled by a power
/// of two, in case that something overflowed. If t and the weights still disagree, `weights`, those
/// of the rounded triangle, decide.
fn settled(
    corners: [[f64; 3]; 3],
    d: [f64; 3],
    slack: f64,
    weights: impl FnOnce() -> [f32; 2],
) -> (f64, f64, f64) {
    let down = power_of_two(d.into_iter().fold(0.0, |most, x| x.abs().max(most)));
    let d = d.map(|x| x * down);
    let (mut t, mut u, mut v) = meet(corners, cross(corners[1], corners[2]), d);
    if !is_near(corners, d, (t, u, v), slack) {
        let [second, third] = weights();
        (u, v) = clamp_barycentrics(second.into(), third.into());
        t = dot(point(corners, u, v), d) / dot(d, d);
    }
    // A NaN becomes 0.
    let t = (t * down).max(0.0);
    (if t.is_finite() { t } else { f64::MAX }, u, v)
}

/// The point of a triangle with the weights `u` and `v`.
#[inline(always)]
fn point([v0, e1, e2]: [[f64; 3]; 3], u: f64, v: f64) -> [f64; 3] {
    [0, 1, 2].map(|k| v0[k] + u * e1[k] + v * e2[k])
}

#[inline(always)]
fn of_lane([x, y, z]: &Doubles3, i: usize) -> [f64; 3] {
    [x[i], y[i], z[i]]
}
