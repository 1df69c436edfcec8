//! Computes t, weights and normals of found hits in f64, from the caller's vertices, 16 hits at a
//! time.
//!
//! Where a ray runs almost in the plane of its triangle, f64 cannot tell where it meets the plane.
//! It may also miss the triangle, whose rounded corners it hits. Then the place that t names is
//! far from the place that the weights name, or the two agree by chance. In both cases the place
//! is taken by which the tree has ordered the hit: the point of the triangle that is nearest to the
//! rounded ray at the tree's t. So a hit is reported where it was the first.
//!
//! Between, f64 tells the place, but single precision does not: the tree may have ordered the hit
//! by a place far away. Then other hits between the two places may be nearer: [`Refined::moved`].

use super::arrays;
use super::batch::RayBatch;
use super::rounded::{Doubles, Rounded, power_of_two};
use super::scene::RayScene;
use crate::geometry::clamp_barycentrics;
use crate::math::{cross, dot, sub};
use crate::ray::LANES;
use crate::simd::{self, Isa, Kernel};

/// The least product of normal and direction, as a fraction of the product of the sums of their
/// magnitudes, from which f64 tells where the ray meets the plane: 2^-32. Rounding moves corners by
/// some 2^-53 of their distance, and so a hit by 2^-21 of it: less than the slack, unless the ray
/// starts far away. Below, t and weights may agree by chance, as both are those of a corner.
const FLAT: f64 = 1.0 / (1u64 << 32) as f64;

/// The least length of the normal, as a fraction of the product of two edges, from which f64 tells
/// more than the tree: 2^-29. f64 rounds the normal by 2^-53 of that product, and the tree moves
/// the plane by 2^-24.
const NEEDLE: f64 = 1.0 / (1u64 << 29) as f64;

/// [`FLAT`] for the tree, up to a few times the slack: 2^-9.
const STEEP: f64 = 1.0 / 512.0;

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
    /// The rounded ray's parameter of the place of t, if it is another place than the tree's by
    /// more than rounding explains. Else NaN. Only with the backend `bvh`.
    pub moved: [f32; LANES],
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

    /// Computes the values of hit `i` again, whose t and weights do not name one place.
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
        let (place, along) = self.found_at(rays, hit);
        let place = sub(place, from);
        let (t, u, v) = settled(corners, direction, slack, place);
        (out.uv[0][i], out.uv[1][i]) = (u, v);
        out.t[i] = t;
        out.counts[i] = counts(t, rays.limits(hit.ray).into(), margin);
        let off = sub(direction.map(|x| t * x), place);
        if self.bvh().is_ok() && off.into_iter().any(|x| x.abs() > slack) {
            out.moved[i] = hit.t + (dot(off, along) / dot(along, along)) as f32;
        }
    }

    /// The point of the rounded ray at which the tree found a hit, and the rounded ray's direction.
    fn found_at(&self, rays: &RayBatch, hit: &FoundHit) -> ([f64; 3], [f64; 3]) {
        let mut rounded = Rounded::EMPTY;
        // The ray was traced, so its values are valid.
        let rounding = self.rounding(rays);
        let _ = rounding.and_then(|rounding| rounding.round(hit.ray, &mut rounded));
        let (line, origin) = (&rounded.packet.rays, self.origin().to_array());
        let direction = line.dir.map(|axis| f64::from(axis[0]));
        let place =
            |k: usize| origin[k] + (f64::from(line.org[k][0]) + f64::from(hit.t) * direction[k]);
        ([0, 1, 2].map(place), direction)
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
            moved: [f32::NAN; LANES],
        };
        let mut agree = [true; LANES];
        for i in 0..LANES {
            let a = of_lane(v0, i);
            let corners =
                [sub(a, of_lane(&from, i)), sub(of_lane(v1, i), a), sub(of_lane(v2, i), a)];
            let normal = cross(corners[1], corners[2]);
            let (t, u, v) = meet(corners, normal, of_lane(&direction, i));
            let t = t.max(0.0);
            agree[i] = is_near(corners, normal, of_lane(&direction, i), (t, u, v), (slack, STEEP));
            (out.uv[0][i], out.uv[1][i]) = (u, v);
            out.t[i] = t;
            out.counts[i] = counts(t, [tnear[i], tfar[i]], margin);
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

/// Whether the places of t and of the weights are within `slack` of each other, and the product of
/// normal and direction is at least the fraction `least`: see [`FLAT`] and [`NEEDLE`].
#[inline(always)]
fn is_near(
    corners: [[f64; 3]; 3],
    normal: [f64; 3],
    d: [f64; 3],
    (t, u, v): (f64, f64, f64),
    (slack, least): (f64, f64),
) -> bool {
    let [x, y, z] = sub(d.map(|x| t * x), point(corners, u, v));
    let sum = |[x, y, z]: [f64; 3]| x.abs() + y.abs() + z.abs();
    let product = dot(normal, d).abs();
    // An infinite product would make t and the weights 0, the first corner.
    let slanted = (product >= least * (sum(normal) * sum(d))) & (product < f64::INFINITY);
    let has_plane = sum(normal) >= NEEDLE * (sum(corners[1]) * sum(corners[2]));
    (x.abs() <= slack) & (y.abs() <= slack) & (z.abs() <= slack) & slanted & has_plane
}

/// Returns t, u and v of a ray for which [`is_near`] is false. The direction is scaled by a power
/// of two, in case that something overflowed. If t and the weights disagree, `place` decides, a
/// point relative to the ray's origin.
fn settled(corners: [[f64; 3]; 3], d: [f64; 3], slack: f64, place: [f64; 3]) -> (f64, f64, f64) {
    let down = power_of_two(d.into_iter().fold(0.0, |most, x| x.abs().max(most)));
    let d = d.map(|x| x * down);
    let normal = cross(corners[1], corners[2]);
    let (mut t, mut u, mut v) = meet(corners, normal, d);
    if !is_near(corners, normal, d, (t, u, v), (slack, FLAT)) {
        (u, v) = nearest_weights(corners, place);
        // A NaN becomes 0.
        t = (dot(point(corners, u, v), d) / dot(d, d)).max(0.0);
    } else if t < 0.0 {
        // The ray starts at the face.
        t = 0.0;
        (u, v) = nearest_weights(corners, [0.0; 3]);
    }
    let t = t * down;
    (if t.is_finite() { t } else { f64::MAX }, u, v)
}

/// Returns the weights of the point of a triangle that is nearest to `place`, up to rounding also
/// for a sliver.
fn nearest_weights(corners: [[f64; 3]; 3], place: [f64; 3]) -> (f64, f64) {
    let [v0, e1, e2] = corners;
    let (way, e3, normal) = (sub(place, v0), sub(e2, e1), cross(e1, e2));
    let inside = [dot(cross(way, e2), normal), dot(cross(e1, way), normal)];
    let [u, v] = inside.map(|x| x / dot(normal, normal));
    // A NaN becomes 0.
    let along = |way, edge| f64::min((dot(way, edge) / dot(edge, edge)).max(0.0), 1.0);
    let third = along(sub(way, e1), e3);
    [(along(way, e1), 0.0), (0.0, along(way, e2)), (1.0 - third, third)].into_iter().fold(
        clamp_barycentrics(u, v),
        |best, weights| {
            let off = |(u, v)| {
                let off = sub(place, point(corners, u, v));
                dot(off, off)
            };
            if off(best) <= off(weights) { best } else { weights }
        },
    )
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
