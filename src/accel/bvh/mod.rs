//! The backend `bvh`: a BVH with 16-wide nodes, leaves of up to 16 triangles over shared vertices,
//! and an exactly watertight triangle test.
//!
//! `build` makes the tree. `query` and `frustum` prepare rays. `single` and `packet` traverse.
//! `simd` tests 16 boxes or triangles at a time. `exact` decides hits. `validate` checks the tree.
//!
//! More queries: `crossings` finds all hits of a ray. `column` finds the triangles that a half-line
//! may hit, `segment` those that a segment may hit. `closest_point` finds the triangle nearest to a
//! point. `winding` computes winding numbers, with the expansions of `multipole`. `owned` is a tree
//! without a borrow.

/// Evaluates `$run` with `$tier` bound to the kernels of the instruction set `$isa`. Returns the
/// value from the enclosing function. `$isa` must be supported by this machine.
macro_rules! with_tier {
    ($isa:expr, $tier:ident => $run:expr) => {
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        if let ($crate::simd::Isa::Avx512, Some($tier)) = ($isa, simd::avx512::Avx512::new()) {
            return $run;
        }
        #[cfg(target_arch = "x86_64")]
        if let ($crate::simd::Isa::Avx2, Some($tier)) = ($isa, simd::avx2::Avx2::new()) {
            return $run;
        }
        #[cfg(target_arch = "aarch64")]
        if $isa == $crate::simd::Isa::Neon {
            let $tier = simd::neon::Neon;
            return $run;
        }
        let $tier = simd::portable::Portable;
        return $run;
    };
}

mod bounds;
mod build;
mod closest_point;
mod column;
mod crossings;
mod exact;
mod frustum;
mod hits;
mod instance;
mod interleaved;
#[doc(hidden)]
pub mod kernels;
mod leaves;
mod local_rays;
mod multipole;
mod near;
mod node;
mod owned;
mod packet;
mod query;
mod segment;
mod shaft;
mod simd;
mod single;
#[cfg(test)]
mod tests;
mod tree;
mod validate;
mod visits;
mod winding;

pub use self::column::HalfLine;
pub use self::crossings::Crossing;
pub use self::owned::OwnedBvh;
pub use self::tree::Bvh;
pub use self::validate::TreeStats;
pub use self::winding::Multipoles;

use self::hits::ClosestHits;
use self::interleaved::{InterleavedClosest, InterleavedOccluded};
use self::packet::{Bits, Packet, Stacks};
use self::query::Query;
use self::shaft::MayHit;
use self::simd::{Path, Stack, Tier};
use self::visits::{Counting, Counts};
use super::accelerator::{Accelerator, BuildInfo, Cone, Visits};
use super::shaft::Shaft;
use crate::geometry::{Geometry, Nearby};
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use crate::simd::Kernel;

/// Finds the closest hits of the active rays, one ray at a time.
struct SingleClosest<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    packet: &'a mut RayPacket,
}

impl<T: Tier> Kernel for SingleClosest<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, packet } = self;
        let query = Query::new(&packet.rays, &bvh.tree.bounds);
        let mut found = ClosestHits::new(&packet.rays);
        let mut stack = Stack::new();
        for i in 0..LANES {
            if active.0[i] != 0 {
                let best = bvh.single(tier, &query, &packet.rays, i).closest(&mut stack);
                best.store(&mut found, i);
            }
        }
        found.store(&bvh.geometry, packet);
    }
}

/// A group of fewer rays than this is traced ray by ray.
const MIN_TOGETHER: u32 = 4;

/// Finds the closest hits of the active rays, in groups that share octant and dominant axis. The
/// rays of groups below [`MIN_TOGETHER`] are traced one by one.
struct PacketClosest<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    packet: &'a mut RayPacket,
}

impl<T: Tier> Kernel for PacketClosest<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, packet } = self;
        let query = Query::new(&packet.rays, &bvh.tree.bounds);
        let scene = (&*bvh.tree, &*bvh.geometry);
        let mut found = ClosestHits::new(&packet.rays);
        let mut stacks = Stacks::take();
        let (mut rest, mut alone) = (tier.bits(active), 0);
        while rest != 0 {
            let part = rest & tier.bits(&query.coherent(rest.trailing_zeros() as usize));
            rest &= !part;
            if part.count_ones() < MIN_TOGETHER {
                alone |= part;
                continue;
            }
            let rays = Packet::new(tier, scene, (&query, &packet.rays), part);
            rays.closest(&mut stacks, &mut found);
        }
        for i in Bits(alone) {
            let best = bvh.single(tier, &query, &packet.rays, i).closest(&mut stacks.single);
            best.store(&mut found, i);
        }
        stacks.keep();
        found.store(&bvh.geometry, packet);
    }
}

/// Tests the active rays for occlusion, one ray at a time.
struct SingleOccluded<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    rays: &'a mut Rays,
}

impl<T: Tier> Kernel for SingleOccluded<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, rays } = self;
        let query = Query::new(rays, &bvh.tree.bounds);
        let mut path = Path::new();
        for i in 0..LANES {
            if active.0[i] != 0 && bvh.single(tier, &query, rays, i).occluded(&mut path) {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
    }
}

/// Tests the active rays for occlusion, in groups that share the dominant axis and the sign along
/// it. The rays of groups below [`MIN_TOGETHER`] are traced one by one.
struct PacketOccluded<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    rays: &'a mut Rays,
}

impl<T: Tier> Kernel for PacketOccluded<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, rays } = self;
        let query = Query::new(rays, &bvh.tree.bounds);
        let scene = (&*bvh.tree, &*bvh.geometry);
        let mut stacks = Stacks::take();
        let (mut rest, mut alone) = (tier.bits(active), 0);
        while rest != 0 {
            let part = rest & tier.bits(&query.aligned(rest.trailing_zeros() as usize));
            rest &= !part;
            if part.count_ones() < MIN_TOGETHER {
                alone |= part;
                continue;
            }
            let packet = Packet::new(tier, scene, (&query, rays), part);
            let occluded = packet.occluded(&mut stacks);
            for i in 0..LANES {
                rays.tfar[i] = if occluded[i] != 0 { f32::NEG_INFINITY } else { rays.tfar[i] };
            }
        }
        for i in Bits(alone) {
            if bvh.single(tier, &query, rays, i).occluded(&mut stacks.single) {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
        stacks.keep();
    }
}

/// Returns what the convex hull of the active rays contains.
struct InCone<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    rays: &'a Rays,
}

impl<T: Tier> Kernel for InCone<'_, T> {
    type Output = Cone;
    #[inline(always)]
    fn run(self) -> Cone {
        let Self { tier, bvh, active, rays } = self;
        let query = Query::new(rays, &bvh.tree.bounds);
        // For rays of several dominant axes or signs the result is conservative. This query is
        // rare, so such rays are not split into groups.
        let active = tier.bits(active);
        if active & !tier.bits(&query.aligned(active.trailing_zeros() as usize)) != 0 {
            return Cone::Any;
        }
        Packet::new(tier, (&*bvh.tree, &*bvh.geometry), (&query, rays), active).contents()
    }
}

impl Bvh<'_> {
    fn closest_with<T: Tier>(
        &self,
        tier: T,
        active: &Mask,
        packet: &mut RayPacket,
        coherence: Coherence,
    ) {
        let bvh = self;
        match coherence {
            Coherence::Coherent => tier.run(PacketClosest { tier, bvh, active, packet }),
            Coherence::Unordered if bvh.tree.closest_in_turns => {
                tier.run(InterleavedClosest { tier, bvh, active, packet });
            }
            Coherence::Incoherent | Coherence::Unordered | Coherence::Single => {
                tier.run(SingleClosest { tier, bvh, active, packet });
            }
        }
    }

    fn occluded_with<T: Tier>(
        &self,
        tier: T,
        active: &Mask,
        rays: &mut Rays,
        coherence: Coherence,
    ) {
        let bvh = self;
        match coherence {
            Coherence::Coherent => tier.run(PacketOccluded { tier, bvh, active, rays }),
            Coherence::Unordered => tier.run(InterleavedOccluded { tier, bvh, active, rays }),
            Coherence::Incoherent | Coherence::Single => {
                tier.run(SingleOccluded { tier, bvh, active, rays });
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
        with_tier!(self.isa, tier => self.closest_with(tier, active, packet, coherence));
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        with_tier!(self.isa, tier => self.occluded_with(tier, active, rays, coherence));
    }

    fn cone(&self, active: &Mask, rays: &Rays) -> Option<Cone> {
        let bvh = self;
        with_tier!(self.isa, tier => Some(tier.run(InCone { tier, bvh, active, rays })));
    }

    fn is_shaft_empty(&self, shaft: &Shaft) -> Option<bool> {
        let bvh = self;
        with_tier!(self.isa, tier => Some(!tier.run(MayHit { tier, bvh, shaft })));
    }

    fn near(&self, _: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.near_in_tree(nearby, found);
    }

    fn visits(
        &self,
        active: &Mask,
        rays: &Rays,
        shadow: bool,
        coherence: Coherence,
    ) -> Option<Visits> {
        let counts = Counts::default();
        // Rounding decides whether a ray hits a box that it only touches. So the portable kernels
        // count on every machine, and every machine gets the same counts.
        let tier = Counting { tier: simd::portable::Portable, counts: &counts };
        let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
        if shadow {
            self.occluded_with(tier, active, &mut packet.rays, coherence);
        } else {
            self.closest_with(tier, active, &mut packet, coherence);
        }
        Some(counts.visits())
    }
}
