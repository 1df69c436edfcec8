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
mod visits;

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
        query: &'a Query,
        rays: &Rays,
        i: usize,
    ) -> Single<'a, T> {
        let lane = query.lane(i);
        let ray = Ray64::new(rays, i, lane.axes[2]);
        let scene = (&self.tree, self.geometry);
        Single::new(tier, scene, lane, ray, rays.leaving[i])
    }

    #[inline(always)]
    fn store(&self, packet: &mut RayPacket, i: usize, (u, v): (f64, f64), best: &Best) {
        if best.primitive == NONE {
            return;
        }
        let (geom, prim) = self.geometry.place(best.primitive);
        packet.rays.tfar[i] = best.t as f32;
        packet.hits.u[i] = u as f32;
        packet.hits.v[i] = v as f32;
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
                let weights = single.barycentrics(&best);
                self.bvh.store(self.packet, i, weights, &best);
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

impl Bvh<'_> {
    #[allow(missing_docs)]
    pub fn debug_visits(&self, active: &Mask, packet: &mut RayPacket, any: bool) -> [u64; 4] {
        let counts = visits::Counts::default();
        let tier = visits::Counting { tier: simd::portable::Portable, counts: &counts };
        if any {
            Occluded { tier, bvh: self, active, rays: &mut packet.rays, coherence: Coherence::Single }.run();
        } else {
            Closest { tier, bvh: self, active, packet, coherence: Coherence::Single }.run();
        }
        [counts.nodes.get(), counts.blocks.get(), counts.triangles.get(), counts.candidates.get()]
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
