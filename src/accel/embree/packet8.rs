//! Packets of 8 rays. On a processor without AVX-512, Embree traces a packet of 16 ray by ray, but
//! has kernels for 8.

use crate::ray::{Hits, LANES, Mask, RayPacket, Rays};

/// Number of rays in a packet.
const WIDTH: usize = 8;

/// First lane of each half of a packet of 16.
pub const HALVES: [usize; 2] = [0, WIDTH];

/// Embree's mask of 8 lanes: -1 for an active lane.
#[repr(C, align(32))]
pub struct Mask8([i32; WIDTH]);

/// `RTCRay8`; the members are those of [`Rays`].
#[repr(C, align(32))]
pub struct Rays8 {
    pub org: [[f32; WIDTH]; 3],
    pub tnear: [f32; WIDTH],
    pub dir: [[f32; WIDTH]; 3],
    pub time: [f32; WIDTH],
    pub tfar: [f32; WIDTH],
    pub mask: [u32; WIDTH],
    pub leaving: [u32; WIDTH],
    pub flags: [u32; WIDTH],
}

/// `RTCHit8`; the members are those of [`Hits`].
#[repr(C, align(32))]
pub struct Hits8 {
    pub ng: [[f32; WIDTH]; 3],
    pub u: [f32; WIDTH],
    pub v: [f32; WIDTH],
    pub prim: [u32; WIDTH],
    pub geom: [u32; WIDTH],
    pub instance: [u32; WIDTH],
    pub instance_prim: [u32; WIDTH],
}

/// Embree's `RTCRayHit8`: eight rays and their hits.
#[repr(C, align(32))]
pub struct RayPacket8 {
    pub rays: Rays8,
    pub hits: Hits8,
}

/// Returns the half of an array that begins at lane `first`.
#[inline(always)]
fn half<T: Copy>(lanes: &[T; LANES], first: usize) -> [T; WIDTH] {
    std::array::from_fn(|i| lanes[first + i])
}

/// Writes the half of an array that begins at lane `first`.
#[inline(always)]
fn put<T: Copy>(lanes: &mut [T; LANES], first: usize, half: &[T; WIDTH]) {
    lanes[first..first + WIDTH].copy_from_slice(half);
}

impl Mask8 {
    /// Returns the half of `active` that begins at lane `first`; `None` if it has no active lane.
    #[inline(always)]
    pub fn half(active: &Mask, first: usize) -> Option<Self> {
        let lanes = half(&active.0, first);
        lanes.iter().any(|&lane| lane != 0).then_some(Self(lanes))
    }
}

impl Rays8 {
    /// Returns the 8 rays from lane `first` on.
    #[inline(always)]
    pub fn half(rays: &Rays, first: usize) -> Self {
        Self {
            org: rays.org.each_ref().map(|axis| half(axis, first)),
            tnear: half(&rays.tnear, first),
            dir: rays.dir.each_ref().map(|axis| half(axis, first)),
            time: half(&rays.time, first),
            tfar: half(&rays.tfar, first),
            mask: half(&rays.mask, first),
            leaving: half(&rays.leaving, first),
            flags: half(&rays.flags, first),
        }
    }

    /// Writes `tfar` to the 8 lanes from `first` on.
    #[inline(always)]
    pub fn store_ends(&self, rays: &mut Rays, first: usize) {
        put(&mut rays.tfar, first, &self.tfar);
    }
}

impl Hits8 {
    #[inline(always)]
    fn half(hits: &Hits, first: usize) -> Self {
        Self {
            ng: hits.ng.each_ref().map(|axis| half(axis, first)),
            u: half(&hits.u, first),
            v: half(&hits.v, first),
            prim: half(&hits.prim, first),
            geom: half(&hits.geom, first),
            instance: half(&hits.instance, first),
            instance_prim: half(&hits.instance_prim, first),
        }
    }
}

impl RayPacket8 {
    /// Returns the 8 rays and hits from lane `first` on.
    #[inline(always)]
    pub fn half(packet: &RayPacket, first: usize) -> Self {
        Self { rays: Rays8::half(&packet.rays, first), hits: Hits8::half(&packet.hits, first) }
    }

    /// Writes `tfar` and the hits to the 8 lanes from `first` on.
    #[inline(always)]
    pub fn store(&self, packet: &mut RayPacket, first: usize) {
        let (hits, found) = (&mut packet.hits, &self.hits);
        for (axis, ng) in hits.ng.iter_mut().zip(&found.ng) {
            put(axis, first, ng);
        }
        put(&mut hits.u, first, &found.u);
        put(&mut hits.v, first, &found.v);
        put(&mut hits.prim, first, &found.prim);
        put(&mut hits.geom, first, &found.geom);
        self.rays.store_ends(&mut packet.rays, first);
    }
}
