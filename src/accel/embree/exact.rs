//! Embree's tree over our own leaves: its speed in finding them, and tests that lose no ray.
//!
//! Each leaf of up to 16 triangles, quad halves or spheres is a primitive of one user geometry, whose
//! box is grown by what the exact test's rounding may ask for ([`Leaves::margin`]).

use std::sync::OnceLock;

use super::device::{self, Device};
use super::ffi::{self, QueryArguments};
use super::leaf::Context;
use super::near::near;
use super::scene::Scene;
use super::{NO_HIT, ray};
use crate::accel::bvh::Bvh;
use crate::accel::bvh::leaves::Leaves;
use crate::accel::bvh::search::{Search, Visitor};
use crate::accel::{Accelerator, BuildInfo, BuildOptions};
use crate::error::Result;
use crate::geometry::{Geometry, Nearby};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};

/// An Embree scene over our leaves.
pub struct Exact<'g> {
    scene: Scene<'g>,
    geometry: &'g Geometry,
    options: BuildOptions,
    /// For rays from beyond the leaves' reach: made when the first one comes.
    far: OnceLock<Bvh<'g>>,
}

impl<'g> Exact<'g> {
    /// Loads the library and builds the scene; the leaves on the current rayon pool.
    ///
    /// # Errors
    /// See [`crate::accel::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let leaves = Leaves::build(geometry, options, monitor)?;
        let left = options.max_bytes.map(|limit| limit.saturating_sub(leaves.bytes()));
        let device = Device::new(device::load_library()?, options.threads, left)?;
        let scene = Scene::build_exact(device, leaves, monitor)?;
        Ok(Self { scene, geometry, options: *options, far: OnceLock::new() })
    }

    fn leaves(&self) -> &Leaves<'g> {
        self.scene.leaves()
    }

    /// The tree for rays that start too far away for the leaves' boxes. Built by a thread and a pool of
    /// its own: a worker of the caller's pool that waited for its own pool would take up other work
    /// there, which may want this tree as well.
    #[cold]
    fn far(&self) -> &Bvh<'g> {
        self.far.get_or_init(|| {
            let options = BuildOptions { max_bytes: None, ..self.options };
            let build = || Bvh::build(self.geometry, &options, &Monitor::default());
            let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
            let built = std::thread::scope(|scope| {
                let alone = || pool.map(|pool| pool.install(build));
                scope.spawn(alone).join()
            });
            let Ok(Ok(Ok(bvh))) = built else {
                panic!("no threads or memory for the tree of rays from afar");
            };
            bvh
        })
    }

    /// Arguments of a query for `context`.
    fn arguments(context: &mut Context, coherent: bool) -> QueryArguments {
        QueryArguments {
            flags: if coherent { ffi::RTC_RAY_QUERY_FLAG_COHERENT } else { 0 },
            feature_mask: u32::MAX,
            context: std::ptr::from_mut(context).cast(),
            filter: None,
            user_geometry: None,
        }
    }
}

/// The numbers of the lanes: what Embree hands back to the callbacks, whatever it makes of a packet.
const NUMBERS: [u32; LANES] = {
    let mut numbers = [0; LANES];
    let mut i = 0;
    while i < LANES {
        numbers[i] = i as u32;
        i += 1;
    }
    numbers
};

impl Search for Exact<'_> {
    fn closest(&self, active: &Mask, packet: &mut RayPacket, visitor: &mut dyn Visitor) {
        packet.rays.leaving = NUMBERS;
        let mut context = Context::new(visitor);
        // SAFETY: packet and mask are aligned to 64 bytes and laid out as Embree's; the context
        // outlives the query.
        unsafe {
            let mut arguments = Self::arguments(&mut context, true);
            (self.scene.api().intersect16)(active, self.scene.handle(), packet, &mut arguments);
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, visitor: &mut dyn Visitor) {
        rays.leaving = NUMBERS;
        let mut context = Context::new(visitor);
        // SAFETY: as above.
        unsafe {
            let mut arguments = Self::arguments(&mut context, true);
            (self.scene.api().occluded16)(active, self.scene.handle(), rays, &mut arguments);
        }
    }

    fn closest_alone(&self, rays: &Rays, lane: usize, visitor: &mut dyn Visitor) {
        let mut single = ffi::RayHit { ray: ray(rays, lane), hit: NO_HIT };
        single.ray.id = lane as u32;
        let mut context = Context::new(visitor);
        // SAFETY: aligned to 16 bytes and laid out as Embree's; the context outlives the query.
        unsafe {
            let mut arguments = Self::arguments(&mut context, false);
            (self.scene.api().intersect1)(self.scene.handle(), &mut single, &mut arguments);
        }
    }

    fn occluded_alone(&self, rays: &Rays, lane: usize, visitor: &mut dyn Visitor) {
        let mut single = ray(rays, lane);
        single.id = lane as u32;
        let mut context = Context::new(visitor);
        // SAFETY: as above.
        unsafe {
            let mut arguments = Self::arguments(&mut context, false);
            (self.scene.api().occluded1)(self.scene.handle(), &mut single, &mut arguments);
        }
    }
}

impl Accelerator for Exact<'_> {
    fn info(&self) -> BuildInfo {
        let info = self.scene.info();
        BuildInfo {
            version: format!("{}, exact", info.version),
            bytes: info.bytes + self.leaves().bytes(),
            peak_bytes: self.leaves().peak_bytes().max(info.peak_bytes + self.leaves().bytes()),
            ..info
        }
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        if !self.leaves().reaches(active, &packet.rays) {
            return self.far().closest(active, packet, coherence);
        }
        self.leaves().closest(active, packet, coherence, self);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        if !self.leaves().reaches(active, rays) {
            return self.far().occluded(active, rays, coherence);
        }
        self.leaves().occluded(active, rays, coherence, self);
    }

    fn near(&self, _: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        near(&self.scene, nearby, &mut |_, leaf| {
            self.leaves().primitives(leaf).for_each(&mut *found)
        });
    }
}
