//! Our own BVH: 16-wide nodes, leaves of up to 16 triangles over shared vertices, an exactly
//! watertight triangle test.
//!
//! [`build`] makes the tree, [`query`] makes rays ready, [`single`] and [`packet`] traverse,
//! [`simd`] tests boxes and triangles 16 at a time, [`exact`] decides.

mod bounds;
mod build;
mod exact;
mod node;
mod query;
mod simd;
mod single;

use self::bounds::Bounds3;
use self::build::Tree;
use self::exact::Ray64;
use self::query::Query;
use self::simd::{Stack, Tier};
use self::single::{Best, Single};
use super::{Accelerator, BuildInfo, BuildOptions};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};
use crate::simd::{Isa, Kernel, dispatch};

/// The tree over a scene's primitives.
pub struct Bvh<'g> {
    geometry: &'g Geometry,
    tree: Tree,
    isa: Isa,
    peak_bytes: u64,
}

impl<'g> Bvh<'g> {
    /// Builds the tree.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let isa = options.isa.min(Isa::detect());
        let (tree, peak_bytes) = build::build(geometry, isa, monitor)?;
        Ok(Self { geometry, tree, isa, peak_bytes })
    }

    #[inline(always)]
    fn single<'a, T: Tier>(
        &'a self,
        tier: T,
        query: &Query,
        rays: &Rays,
        i: usize,
    ) -> Single<'a, T> {
        let lane = query.lane(rays, i);
        let ray = Ray64::new(rays, i, lane.axes[2]);
        Single {
            tier,
            tree: &self.tree,
            geometry: self.geometry,
            lane,
            ray,
            scale: query.scale[i],
            leaving: self.leaving(rays.leaving[i]),
        }
    }

    /// The planar primitive that a ray cannot meet again.
    #[inline(always)]
    fn leaving(&self, primitive: u32) -> u32 {
        primitive
    }

    #[inline(always)]
    fn store(&self, packet: &mut RayPacket, i: usize, best: &Best) {
        if best.primitive == NONE {
            return;
        }
        let (geom, prim) = self.geometry.place(best.primitive);
        packet.rays.tfar[i] = best.t as f32;
        packet.hits.u[i] = best.u as f32;
        packet.hits.v[i] = best.v as f32;
        packet.hits.geom[i] = geom;
        packet.hits.prim[i] = prim;
    }
}

struct Closest<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    packet: &'a mut RayPacket,
    coherence: Coherence,
}

impl<T: Tier> Kernel for Closest<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let query = Query::new(&self.packet.rays, &self.bvh.tree.bounds);
        let mut stack = Stack::new();
        let _ = self.coherence;
        for i in 0..LANES {
            if self.active.0[i] != 0 {
                let single = self.bvh.single(self.tier, &query, &self.packet.rays, i);
                let best = single.closest(&mut stack);
                self.bvh.store(self.packet, i, &best);
            }
        }
    }
}

struct Occluded<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    rays: &'a mut Rays,
    coherence: Coherence,
}

impl<T: Tier> Kernel for Occluded<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let query = Query::new(self.rays, &self.bvh.tree.bounds);
        let mut stack = Stack::new();
        let _ = self.coherence;
        for i in 0..LANES {
            if self.active.0[i] != 0 {
                let single = self.bvh.single(self.tier, &query, self.rays, i);
                if single.occluded(&mut stack) {
                    self.rays.tfar[i] = f32::NEG_INFINITY;
                }
            }
        }
    }
}

impl Accelerator for Bvh<'_> {
    fn info(&self) -> BuildInfo {
        BuildInfo {
            version: format!("lightpath BVH {}", env!("CARGO_PKG_VERSION")),
            isa: self.isa.to_string(),
            bytes: self.tree.bytes(),
            peak_bytes: self.peak_bytes,
        }
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        let bvh = self;
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        if self.isa == Isa::Avx512 {
            if let Some(tier) = simd::avx512::Avx512::new() {
                return dispatch(self.isa, Closest { tier, bvh, active, packet, coherence });
            }
        }
        let tier = simd::portable::Portable;
        dispatch(self.isa, Closest { tier, bvh, active, packet, coherence });
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        let bvh = self;
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        if self.isa == Isa::Avx512 {
            if let Some(tier) = simd::avx512::Avx512::new() {
                return dispatch(self.isa, Occluded { tier, bvh, active, rays, coherence });
            }
        }
        let tier = simd::portable::Portable;
        dispatch(self.isa, Occluded { tier, bvh, active, rays, coherence });
    }
}
