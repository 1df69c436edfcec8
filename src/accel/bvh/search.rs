//! The exact tests of leaves that somebody else's tree finds.

use super::LEAST_TOGETHER;
use super::found::Found;
use super::leaves::Leaves;
use super::packet::Packet;
use super::query::{LEAST, Query};
use super::simd::{self, Tier};
use super::single::{Best, Single};
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use crate::simd::{Isa, Kernel};

/// What tests the leaves that a search finds.
pub trait Visitor {
    /// Tests a leaf for the rays of `lanes`, by bit; the ends of all 16 segments, rounded up: where
    /// the closest hit is, -inf for a shadow ray that was stopped.
    fn visit(&mut self, leaf: usize, lanes: u32) -> &[f32; LANES];
}

/// A tree that finds leaves: it shows the visitor every leaf whose box, grown by
/// [`Leaves::margin`], a ray meets before its end, in any order. Its rays are scaled so that the
/// largest component of each direction is in [1, 2).
pub trait Search {
    /// The active rays; may overwrite them.
    fn closest(&self, active: &Mask, packet: &mut RayPacket, visitor: &mut dyn Visitor);

    /// Until all active rays are stopped; may overwrite them.
    fn occluded(&self, active: &Mask, rays: &mut Rays, visitor: &mut dyn Visitor);

    /// One ray.
    fn closest_alone(&self, rays: &Rays, lane: usize, visitor: &mut dyn Visitor);

    /// One ray, until it is stopped.
    fn occluded_alone(&self, rays: &Rays, lane: usize, visitor: &mut dyn Visitor);
}

impl Leaves<'_> {
    /// As [`crate::accel::Accelerator::closest`].
    pub fn closest(
        &self,
        active: &Mask,
        packet: &mut RayPacket,
        coherence: Coherence,
        search: &impl Search,
    ) {
        let leaves = self;
        with_tier!(self.isa, tier => {
            tier.run(Closest { tier, leaves, active, packet, coherence, search })
        });
    }

    /// As [`crate::accel::Accelerator::occluded`].
    pub fn occluded(
        &self,
        active: &Mask,
        rays: &mut Rays,
        coherence: Coherence,
        search: &impl Search,
    ) {
        let leaves = self;
        with_tier!(self.isa, tier => {
            tier.run(Occluded { tier, leaves, active, rays, coherence, search })
        });
    }
}

struct Closest<'a, T, S> {
    tier: T,
    leaves: &'a Leaves<'a>,
    active: &'a Mask,
    packet: &'a mut RayPacket,
    coherence: Coherence,
    search: &'a S,
}

impl<T: Tier, S: Search> Kernel for Closest<'_, T, S> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, leaves, active, packet, coherence, search } = self;
        let scene = (&leaves.tree, leaves.geometry);
        // The exact tests look at the rays as they are, while the search shortens its own.
        let rays = packet.rays.clone();
        let query = Query::new(&rays, &leaves.tree.bounds);
        let mut found = Found::nothing(&rays);
        scale(&query, &mut packet.rays);
        let mut rest = *active;
        while rest.any() {
            let part = part(&query, &rest, coherence);
            rest = rest.without(&part);
            if coherence == Coherence::Coherent && part.count() >= LEAST_TOGETHER {
                let together = Packet::new(tier, scene, (&query, &rays), &part);
                let (found, ends) = (&mut found, query.tfar);
                let mut visitor = ClosestTogether { leaves, together, found, ends };
                search.closest(&part, packet, &mut visitor);
                continue;
            }
            for i in 0..LANES {
                if part.0[i] != 0 {
                    let single = Single::new(tier, scene, query.lane(i), &rays);
                    let best = single.nothing();
                    let mut visitor =
                        ClosestAlone { tier, leaves, single, best, i, ends: query.tfar };
                    search.closest_alone(&packet.rays, i, &mut visitor);
                    visitor.best.store(&mut found, i);
                }
            }
        }
        packet.rays = rays;
        found.store(leaves.geometry, packet);
    }
}

/// What pays for the rounding of an end.
const LONGER: f32 = 1.0 + 2.0 * f32::EPSILON;

/// Makes the largest component of each direction one in [1, 2), exactly; components that are nothing
/// beside it become 0, as for our own boxes they become [`LEAST`]: Embree replaces what is below 1e-18
/// by that, of whatever sign it was.
#[inline(always)]
fn scale(query: &Query, rays: &mut Rays) {
    for i in 0..LANES {
        let down = 1.0 / query.scale[i];
        for axis in 0..3 {
            let d = rays.dir[axis][i] * down;
            rays.dir[axis][i] = if d.abs() < 2.0 * LEAST { 0.0 } else { d };
        }
        rays.tnear[i] = query.tnear[i];
        rays.tfar[i] = query.tfar[i];
    }
}

/// The rays that are looked at next.
#[inline(always)]
fn part(query: &Query, rest: &Mask, coherence: Coherence) -> Mask {
    if coherence == Coherence::Coherent { query.coherent(rest) } else { *rest }
}

struct ClosestTogether<'a, 'f, T> {
    leaves: &'a Leaves<'a>,
    together: Packet<'a, T>,
    found: &'f mut Found,
    ends: [f32; LANES],
}

impl<T: Tier> Visitor for ClosestTogether<'_, '_, T> {
    fn visit(&mut self, leaf: usize, lanes: u32) -> &[f32; LANES] {
        self.together.tier().run(InLeaf { visitor: self, leaf, lanes });
        &self.ends
    }
}

struct InLeaf<'v, V> {
    visitor: &'v mut V,
    leaf: usize,
    lanes: u32,
}

impl<T: Tier> Kernel for InLeaf<'_, ClosestTogether<'_, '_, T>> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { visitor, leaf, lanes } = self;
        let child = visitor.leaves.child(leaf);
        visitor.together.closest_in_leaf(child, lanes, visitor.found);
        visitor.together.shorten();
        let tfar = visitor.together.tfar();
        for i in 0..LANES {
            visitor.ends[i] = tfar[i] * LONGER;
        }
    }
}

struct ClosestAlone<'a, T> {
    tier: T,
    leaves: &'a Leaves<'a>,
    single: Single<'a, T>,
    best: Best,
    i: usize,
    ends: [f32; LANES],
}

impl<T: Tier> Visitor for ClosestAlone<'_, T> {
    fn visit(&mut self, leaf: usize, lanes: u32) -> &[f32; LANES] {
        self.tier.run(InLeaf { visitor: self, leaf, lanes });
        &self.ends
    }
}

impl<T: Tier> Kernel for InLeaf<'_, ClosestAlone<'_, T>> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { visitor, leaf, .. } = self;
        visitor.single.closest_in_leaf(visitor.leaves.child(leaf), &mut visitor.best);
        visitor.ends[visitor.i % LANES] = visitor.best.tfar * LONGER;
    }
}

struct Occluded<'a, T, S> {
    tier: T,
    leaves: &'a Leaves<'a>,
    active: &'a Mask,
    rays: &'a mut Rays,
    coherence: Coherence,
    search: &'a S,
}

impl<T: Tier, S: Search> Kernel for Occluded<'_, T, S> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, leaves, active, rays, coherence, search } = self;
        let scene = (&leaves.tree, leaves.geometry);
        let query = Query::new(rays, &leaves.tree.bounds);
        let mut scaled = rays.clone();
        scale(&query, &mut scaled);
        let mut stopped = [0; LANES];
        let mut rest = *active;
        while rest.any() {
            let part = part(&query, &rest, coherence);
            rest = rest.without(&part);
            if coherence == Coherence::Coherent && part.count() >= LEAST_TOGETHER {
                let together = Packet::new(tier, scene, (&query, &*rays), &part);
                let ends = query.tfar;
                let mut visitor = AnyTogether { leaves, together, stopped, ends };
                let mut searched = scaled.clone();
                search.occluded(&part, &mut searched, &mut visitor);
                stopped = visitor.stopped;
                continue;
            }
            for i in 0..LANES {
                if part.0[i] != 0 {
                    let single = Single::new(tier, scene, query.lane(i), rays);
                    let mut visitor = AnyAlone { tier, leaves, single, i, ends: query.tfar };
                    search.occluded_alone(&scaled, i, &mut visitor);
                    stopped[i] |= -i32::from(visitor.ends[i] == f32::NEG_INFINITY);
                }
            }
        }
        for i in 0..LANES {
            rays.tfar[i] = if stopped[i] != 0 { f32::NEG_INFINITY } else { rays.tfar[i] };
        }
    }
}

struct AnyTogether<'a, T> {
    leaves: &'a Leaves<'a>,
    together: Packet<'a, T>,
    stopped: [i32; LANES],
    ends: [f32; LANES],
}

impl<T: Tier> Visitor for AnyTogether<'_, T> {
    fn visit(&mut self, leaf: usize, lanes: u32) -> &[f32; LANES] {
        self.together.tier().run(InLeaf { visitor: self, leaf, lanes });
        &self.ends
    }
}

impl<T: Tier> Kernel for InLeaf<'_, AnyTogether<'_, T>> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { visitor, leaf, lanes } = self;
        let child = visitor.leaves.child(leaf);
        visitor.together.any_in_leaf(child, lanes, &mut visitor.stopped);
        for i in 0..LANES {
            let stopped = visitor.stopped[i] != 0;
            visitor.ends[i] = if stopped { f32::NEG_INFINITY } else { visitor.ends[i] };
        }
    }
}

struct AnyAlone<'a, T> {
    tier: T,
    leaves: &'a Leaves<'a>,
    single: Single<'a, T>,
    i: usize,
    ends: [f32; LANES],
}

impl<T: Tier> Visitor for AnyAlone<'_, T> {
    fn visit(&mut self, leaf: usize, lanes: u32) -> &[f32; LANES] {
        self.tier.run(InLeaf { visitor: self, leaf, lanes });
        &self.ends
    }
}

impl<T: Tier> Kernel for InLeaf<'_, AnyAlone<'_, T>> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { visitor, leaf, .. } = self;
        if visitor.single.any_in_leaf(visitor.leaves.child(leaf)) {
            visitor.ends[visitor.i % LANES] = f32::NEG_INFINITY;
        }
    }
}
