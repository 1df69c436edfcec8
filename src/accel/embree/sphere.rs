//! Spheres as Embree user geometry: callbacks for any packet width, with our own f64 intersection.

use std::ffi::c_uint;

use glam::DVec3;

use super::ffi::{BoundsArguments, RtcBounds, UserArguments};
use crate::accel::geometry_ref::GeometryRef;
use crate::geometry::Unseen;

/// User data of the callbacks.
pub struct SphereSet<'g> {
    pub geometry: GeometryRef<'g>,
    /// Scene-wide primitive index of the first sphere.
    pub base: u32,
    /// Primitives that are not part of the scene.
    pub unseen: Unseen,
}

/// The lanes of an `RTCRayN`: member `k` of lane `i` is at `k * n + i`.
#[derive(Clone, Copy)]
struct RayLanes {
    first: *mut f32,
    n: usize,
}

impl RayLanes {
    const TNEAR: usize = 3;
    const TFAR: usize = 8;
    const ID: usize = 10;
    /// First member of the `RTCHitN` that follows the rays of an `RTCRayHitN`.
    const HIT: usize = 12;

    /// # Safety
    /// `member` exists and `lane < n`.
    unsafe fn get(self, member: usize, lane: usize) -> f32 {
        // SAFETY: the caller's promise.
        unsafe { *self.first.add(member * self.n + lane) }
    }

    /// # Safety
    /// As for `get`.
    unsafe fn set(self, member: usize, lane: usize, value: f32) {
        // SAFETY: the caller's promise.
        unsafe { *self.first.add(member * self.n + lane) = value }
    }

    /// # Safety
    /// As for `get`.
    unsafe fn set_id(self, member: usize, lane: usize, value: c_uint) {
        // SAFETY: ids are 32-bit members in the same array.
        unsafe { self.set(member, lane, f32::from_bits(value)) }
    }

    /// # Safety
    /// As for `get`.
    unsafe fn vector(self, member: usize, lane: usize) -> DVec3 {
        // SAFETY: the caller's promise.
        let [x, y, z] = [0, 1, 2].map(|k| unsafe { f64::from(self.get(member + k, lane)) });
        DVec3::new(x, y, z)
    }
}

/// Calls `found(lanes, lane, t, normal)` for every valid lane that hits the sphere before `tfar`.
/// The normal may have any length.
///
/// # Safety
/// `args` comes from Embree, for a geometry whose user data is a live `SphereSet`.
unsafe fn each_hit(args: &UserArguments, mut found: impl FnMut(RayLanes, usize, f32, DVec3)) {
    // SAFETY: the caller's promise.
    let set = unsafe { &*args.user.cast::<SphereSet>() };
    let Some(sphere) = set.geometry.spheres.get(args.prim_id as usize) else {
        return;
    };
    let lanes = RayLanes { first: args.rays, n: args.n as usize };
    for lane in 0..lanes.n {
        // SAFETY: Embree passes `n` valid flags and `n` lanes of every member.
        let (valid, origin, direction, tnear, tfar, leaving) = unsafe {
            (
                *args.valid.add(lane) != 0,
                lanes.vector(0, lane),
                lanes.vector(4, lane),
                lanes.get(RayLanes::TNEAR, lane),
                lanes.get(RayLanes::TFAR, lane),
                lanes.get(RayLanes::ID, lane).to_bits() == set.base + args.prim_id,
            )
        };
        if !valid {
            continue;
        }
        let t = sphere.intersect(origin, direction, tnear.into(), tfar.into(), leaving);
        let t32 = t as f32;
        // Rounding to f32 may raise t to `tfar`, the t of a hit found before. A miss is NaN and
        // fails both comparisons.
        if t32 >= tnear && t32 < tfar {
            found(lanes, lane, t32, origin + direction * t - sphere.center);
        }
    }
}

pub unsafe extern "C" fn bounds(args: *const BoundsArguments) {
    // SAFETY: Embree passes valid arguments; the user data is a live `SphereSet`.
    let (args, set) = unsafe { (&*args, &*(*args).user.cast::<SphereSet>()) };
    let Some(sphere) = set.geometry.spheres.get(args.prim_id as usize) else {
        return;
    };
    let (lower, upper) = match set.unseen.has(set.base + args.prim_id) {
        false => sphere.bounds(),
        // Embree leaves out a primitive with an empty box.
        true => ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]),
    };
    // SAFETY: Embree passes room for one box.
    unsafe { *args.bounds = RtcBounds { lower, align0: 0.0, upper, align1: 0.0 } };
}

pub unsafe extern "C" fn intersect(args: *const UserArguments) {
    // SAFETY: Embree passes valid arguments.
    let args = unsafe { &*args };
    let record = |lanes: RayLanes, lane: usize, t: f32, normal: DVec3| {
        // SAFETY: an intersection query has the members of `RTCRayHitN`.
        unsafe {
            lanes.set(RayLanes::TFAR, lane, t);
            for (k, n) in normal.to_array().into_iter().enumerate() {
                lanes.set(RayLanes::HIT + k, lane, n as f32);
            }
            lanes.set(RayLanes::HIT + 3, lane, 0.0);
            lanes.set(RayLanes::HIT + 4, lane, 0.0);
            lanes.set_id(RayLanes::HIT + 5, lane, args.prim_id);
            lanes.set_id(RayLanes::HIT + 6, lane, args.geom_id);
            lanes.set_id(RayLanes::HIT + 7, lane, u32::MAX);
        }
    };
    // SAFETY: as above; the user data is a live `SphereSet`.
    unsafe { each_hit(args, record) };
}

pub unsafe extern "C" fn occluded(args: *const UserArguments) {
    // SAFETY: Embree passes valid arguments; `RTCRayN` has a `tfar`.
    unsafe {
        each_hit(&*args, |lanes, lane, _, _| lanes.set(RayLanes::TFAR, lane, f32::NEG_INFINITY));
    }
}
