//! Packets of 8 rays. On a processor without AVX-512, Embree traces a packet of 16 ray by ray, but
//! has kernels for 8.

use super::ffi::{Api, QueryArguments, SceneHandle};
use crate::ray::{Hits, LANES, Mask, RayPacket, Rays};

/// Number of rays.
const WIDTH: usize = 8;

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

/// `RTCRayHit8`.
#[repr(C, align(32))]
pub struct RayPacket8 {
    pub rays: Rays8,
    pub hits: Hits8,
}

/// The half of an array that begins at lane `first`.
#[inline(always)]
fn half<T: Copy>(lanes: &[T; LANES], first: usize) -> [T; WIDTH] {
    std::array::from_fn(|i| lanes[first + i])
}

/// Writes the half of an array that begins at lane `first`.
#[inline(always)]
fn put<T: Copy>(lanes: &mut [T; LANES], first: usize, half: &[T; WIDTH]) {
    for i in 0..WIDTH {
        lanes[first + i] = half[i];
    }
}

impl Mask8 {
    /// The half of `active` that begins at lane `first`; `None` if no lane of it is active.
    #[inline(always)]
    fn half(active: &Mask, first: usize) -> Option<Self> {
        let lanes = half(&active.0, first);
        lanes.iter().any(|&lane| lane != 0).then_some(Self(lanes))
    }
}

impl Rays8 {
    #[inline(always)]
    fn half(rays: &Rays, first: usize) -> Self {
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

/// `rtcIntersect16` by `rtcIntersect8`.
///
/// # Safety
/// The scene is committed, `args` is valid, and both belong to the library of `api`.
pub unsafe fn intersect(
    api: &Api,
    scene: *mut SceneHandle,
    active: &Mask,
    packet: &mut RayPacket,
    args: *mut QueryArguments,
) {
    for first in [0, WIDTH] {
        let Some(mask) = Mask8::half(active, first) else { continue };
        let (rays, hits) = (Rays8::half(&packet.rays, first), Hits8::half(&packet.hits, first));
        let mut part = RayPacket8 { rays, hits };
        // SAFETY: as the caller promises; aligned to 32 bytes and laid out as Embree's.
        unsafe { (api.intersect8)(&raw const mask, scene, &raw mut part, args) };
        let (hits, rays) = (&mut packet.hits, &mut packet.rays);
        put(&mut rays.tfar, first, &part.rays.tfar);
        for (axis, found) in hits.ng.iter_mut().zip(&part.hits.ng) {
            put(axis, first, found);
        }
        put(&mut hits.u, first, &part.hits.u);
        put(&mut hits.v, first, &part.hits.v);
        put(&mut hits.prim, first, &part.hits.prim);
        put(&mut hits.geom, first, &part.hits.geom);
    }
}

/// `rtcOccluded16` by `rtcOccluded8`.
///
/// # Safety
/// As for [`intersect`].
pub unsafe fn occluded(
    api: &Api,
    scene: *mut SceneHandle,
    active: &Mask,
    rays: &mut Rays,
    args: *mut QueryArguments,
) {
    for first in [0, WIDTH] {
        let Some(mask) = Mask8::half(active, first) else { continue };
        let mut part = Rays8::half(rays, first);
        // SAFETY: as the caller promises; aligned to 32 bytes and laid out as Embree's.
        unsafe { (api.occluded8)(&raw const mask, scene, &raw mut part, args) };
        put(&mut rays.tfar, first, &part.tfar);
    }
}
