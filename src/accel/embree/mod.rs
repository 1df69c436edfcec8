//! Intel Embree 4 as an accelerator. No raw pointer and no `unsafe` leaves this folder.

mod candidate;
mod device;
mod extent;
mod ffi;
mod filter;
mod fixed;
mod near;
mod packet8;
mod retrace;
mod scene;
mod search;
mod sphere;

pub use self::ffi::{LAYOUTS, StructLayout};

use self::device::Device;
use self::ffi::{QueryArguments, QueryContext};
use self::filter::{HitFilter, HitValidator};
use self::packet8::{HALVES, Mask8, RayPacket8, Rays8};
use super::accelerator::{Accelerator, BuildInfo, BuildOptions};
use super::geometry_ref::GeometryRef;
use crate::error::Result;
use crate::geometry::{Geometry, NONE, Nearby, Unseen};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use crate::scene::EmbreeMode;
use crate::simd::{self, Isa, Kernel};

/// With fewer active lanes than this, single rays are faster than a packet.
const SINGLE_BELOW: u32 = 4;

/// The accelerator of the backend `embree`. Its scene reads the arrays of whole meshes without
/// copies.
pub struct Embree<'g> {
    scene: scene::EmbreeScene<'g>,
    truth: HitValidator<'g>,
    /// Whether a packet is traced as two packets of 8: see [`packet8`].
    halves: bool,
}

impl<'g> Embree<'g> {
    /// Loads the library and builds Embree's tree over the primitives that are not in `unseen`.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build_part(
        (geometry, unseen): (GeometryRef<'g>, &Unseen),
        mode: EmbreeMode,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let device = Device::new(device::load_library()?, options.threads, options.max_bytes)?;
        let halves = device.has_packets_of_8() && !device.has_packets_of_16();
        let scene = scene::EmbreeScene::build(device, (geometry.clone(), unseen), mode, monitor)?;
        Ok(Self { scene, truth: HitValidator::new(geometry), halves })
    }

    /// Calls `query` with Embree's arguments for this coherence and filter.
    #[inline(always)]
    fn query(
        &self,
        coherence: Coherence,
        filter: Option<HitFilter>,
        query: impl FnOnce(*mut QueryArguments),
    ) {
        let mut context = QueryContext {
            inst_id: NONE,
            inst_prim_id: NONE,
            bases: self.truth.geometry.bases().as_ptr(),
            filter: filter.as_ref().map_or(std::ptr::null(), HitFilter::data),
        };
        let coherent = match coherence {
            Coherence::Coherent => ffi::RTC_RAY_QUERY_FLAG_COHERENT,
            Coherence::Incoherent | Coherence::Unordered | Coherence::Single => 0,
        };
        let invoke = match filter {
            Some(_) => ffi::RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER,
            None => 0,
        };
        query(&mut QueryArguments {
            flags: coherent | invoke,
            feature_mask: u32::MAX,
            context: &mut context,
            filter: filter.as_ref().map(HitFilter::function),
            user_geometry: None,
        });
    }

    /// Sets `tfar` to -inf for each active ray that a candidate accepted by `filter` occludes.
    /// `lanes` is the number of active rays.
    #[inline(always)]
    fn any_hit(
        &self,
        active: &Mask,
        rays: &mut Rays,
        coherence: Coherence,
        lanes: u32,
        filter: Option<HitFilter>,
    ) {
        let scene = self.scene.handle();
        if coherence != Coherence::Single && lanes >= SINGLE_BELOW {
            let api = self.scene.api();
            return self.query(coherence, filter, |args| {
                if !self.halves {
                    // SAFETY: rays and mask are aligned to 64 bytes and laid out as Embree's.
                    return unsafe { (api.occluded16)(active, scene, rays, args) };
                }
                for first in HALVES {
                    let Some(mask) = Mask8::half(active, first) else { continue };
                    let mut half = Rays8::half(rays, first);
                    // SAFETY: as above, aligned to 32 bytes.
                    unsafe { (api.occluded8)(&raw const mask, scene, &raw mut half, args) };
                    half.store_ends(rays, first);
                }
            });
        }
        for i in (0..LANES).filter(|&i| active.0[i] != 0) {
            let mut single = ray(rays, i);
            // SAFETY: aligned to 16 bytes and laid out as Embree's.
            self.query(coherence, filter, |args| unsafe {
                (self.scene.api().occluded1)(scene, &mut single, args);
            });
            rays.tfar[i] = single.tfar;
        }
    }
}

/// Prepares a packet for Embree: raises `tnear` above 0 and counts active lanes.
///
/// Embree's segments are closed and ours are open. So a ray from 0 starts at the smallest normal
/// number, and a hit at 0 does not count.
///
/// This is a kernel of full-width loads, because the packet has just been written in whole
/// registers. Narrower loads would wait until the packet is in the cache.
struct PreparePacket<'a> {
    active: &'a Mask,
    rays: &'a mut Rays,
}

impl Kernel for PreparePacket<'_> {
    /// Number of active lanes, and whether any of them leaves a primitive.
    type Output = (u32, bool);

    #[inline(always)]
    fn run(self) -> (u32, bool) {
        let (mut lanes, mut leaving) = (0, 0);
        for i in 0..LANES {
            let active = self.active.0[i];
            lanes += active & 1;
            leaving |= active & -i32::from(self.rays.leaving[i] != NONE);
            let tnear = self.rays.tnear[i];
            self.rays.tnear[i] = if tnear > f32::MIN_POSITIVE { tnear } else { f32::MIN_POSITIVE };
        }
        (lanes as u32, leaving != 0)
    }
}

fn ray(rays: &Rays, i: usize) -> ffi::RtcRay {
    ffi::RtcRay {
        org: [rays.org[0][i], rays.org[1][i], rays.org[2][i]],
        tnear: rays.tnear[i],
        dir: [rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]],
        time: rays.tfar[i],
        tfar: rays.tfar[i],
        mask: u32::MAX,
        id: rays.leaving[i],
        flags: 0,
    }
}

const NO_HIT: ffi::RtcHit = ffi::RtcHit {
    ng: [0.0; 3],
    u: 0.0,
    v: 0.0,
    prim_id: NONE,
    geom_id: NONE,
    inst_id: NONE,
    inst_prim_id: NONE,
};

impl Accelerator for Embree<'_> {
    fn info(&self) -> BuildInfo {
        self.scene.info()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        let tfar = packet.rays.tfar;
        self.closest_unfiltered(active, packet, coherence);
        self.retrace_rejected(active, packet, &tfar);
    }

    fn false_hits(&self) -> u64 {
        self.truth.false_hits()
    }

    fn closest_unfiltered(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        let (lanes, leaving) =
            simd::dispatch(Isa::detect(), PreparePacket { active, rays: &mut packet.rays });
        let filter = leaving.then_some(HitFilter::Leaving);
        let scene = self.scene.handle();
        if coherence != Coherence::Single && lanes >= SINGLE_BELOW {
            let api = self.scene.api();
            return self.query(coherence, filter, |args| {
                if !self.halves {
                    // SAFETY: packet and mask are aligned to 64 bytes and laid out as Embree's.
                    return unsafe { (api.intersect16)(active, scene, packet, args) };
                }
                for first in HALVES {
                    let Some(mask) = Mask8::half(active, first) else { continue };
                    let mut half = RayPacket8::half(packet, first);
                    // SAFETY: as above, aligned to 32 bytes.
                    unsafe { (api.intersect8)(&raw const mask, scene, &raw mut half, args) };
                    half.store(packet, first);
                }
            });
        }
        for i in (0..LANES).filter(|&i| active.0[i] != 0) {
            let mut single = ffi::RtcRayHit { ray: ray(&packet.rays, i), hit: NO_HIT };
            // SAFETY: aligned to 16 bytes and laid out as Embree's.
            self.query(coherence, filter, |args| unsafe {
                (self.scene.api().intersect1)(scene, &mut single, args);
            });
            packet.rays.tfar[i] = single.ray.tfar;
            (packet.hits.u[i], packet.hits.v[i]) = (single.hit.u, single.hit.v);
            (packet.hits.prim[i], packet.hits.geom[i]) = (single.hit.prim_id, single.hit.geom_id);
            for (lanes, n) in packet.hits.ng.iter_mut().zip(single.hit.ng) {
                lanes[i] = n;
            }
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        // `time` keeps the end of each ray for the filter, where `tfar` is the candidate's t.
        // Embree does not read `time` in a scene without motion.
        rays.time = rays.tfar;
        let (lanes, _) = simd::dispatch(Isa::detect(), PreparePacket { active, rays: &mut *rays });
        self.any_hit(active, rays, coherence, lanes, Some(HitFilter::TrueHits(&self.truth)));
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        near::near(&self.scene, nearby, &mut |geom, prim| found(geometry.primitive(geom, prim)));
    }

    fn occluded_unfiltered(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        let (lanes, leaving) =
            simd::dispatch(Isa::detect(), PreparePacket { active, rays: &mut *rays });
        self.any_hit(active, rays, coherence, lanes, leaving.then_some(HitFilter::Leaving));
    }
}

/// Returns version and instruction set of the Embree library that would be used.
///
/// # Errors
/// `Unsupported` if the library cannot be loaded or used here, `Retry` if memory ran out.
pub fn describe() -> Result<(String, String)> {
    let device = Device::new(device::load_library()?, 0, None)?;
    let [major, minor, patch] = device.version();
    Ok((format!("Embree {major}.{minor}.{patch}"), device.isa().to_owned()))
}
