//! Traversals of several rays that have nothing in common, each on its own, in turns.
//!
//! Such rays visit different parts of the tree, so most visits wait for memory. After each
//! visit of a ray its next node or leaf is prefetched, and the other rays go on. Each ray visits
//! the same nodes and leaves in the same order as in [`Single`], so the answers are the same.

use super::build::Tree;
use super::hits::ClosestHits;
use super::node::{Child, ChildKind};
use super::packet::Bits;
use super::query::Query;
use super::simd::{Paths, Stack, Tier};
use super::single::{ClosestHit, Single};
use super::tree::Bvh;
use crate::geometry::Geometry;
use crate::ray::{LANES, Mask, RayPacket, Rays};
use crate::simd::Kernel;

/// Number of closest-hit traversals that take turns. Stacks of more rays push nodes out of the
/// first-level cache.
const TOGETHER: usize = 3;

/// Finds the closest hits of the active rays, in turns.
pub struct InterleavedClosest<'a, T> {
    pub tier: T,
    pub bvh: &'a Bvh<'a>,
    pub active: &'a Mask,
    pub packet: &'a mut RayPacket,
}

impl<T: Tier> Kernel for InterleavedClosest<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, packet } = self;
        let query = Query::new(&packet.rays, &bvh.tree.bounds);
        let mut found = ClosestHits::new(&packet.rays);
        let rays = Interleaved::new(tier, bvh, &query, &packet.rays);
        rays.closest(tier.bits(active), &mut found);
        found.store(&bvh.geometry, packet);
    }
}

/// Tests the active rays for occlusion, in turns.
pub struct InterleavedOccluded<'a, T> {
    pub tier: T,
    pub bvh: &'a Bvh<'a>,
    pub active: &'a Mask,
    pub rays: &'a mut Rays,
}

impl<T: Tier> Kernel for InterleavedOccluded<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, rays } = self;
        let query = Query::new(rays, &bvh.tree.bounds);
        let mut occluded = Occluded(0);
        Interleaved::new(tier, bvh, &query, rays).visit(tier.bits(active), &mut occluded);
        for i in Bits(occluded.0) {
            rays.tfar[i] = f32::NEG_INFINITY;
        }
    }
}

/// What happens in the leaves that rays enter.
pub trait LeafVisitor {
    /// Tests a ray against a leaf. Returns true if the ray is finished.
    fn visit<T: Tier>(&mut self, ray: &Single<T>, leaf: Child) -> bool;
}

/// The occluded rays, as bits.
struct Occluded(u32);

impl LeafVisitor for Occluded {
    #[inline(always)]
    fn visit<T: Tier>(&mut self, ray: &Single<T>, leaf: Child) -> bool {
        let hit = ray.any_in_leaf(leaf);
        self.0 |= u32::from(hit) << (ray.lane.i % LANES);
        hit
    }
}

/// Rays that traverse a tree in turns.
pub struct Interleaved<'a, T> {
    tier: T,
    tree: &'a Tree,
    geometry: &'a Geometry,
    query: &'a Query,
    rays: &'a Rays,
}

impl<'a, T: Tier> Interleaved<'a, T> {
    #[inline(always)]
    pub fn new(tier: T, bvh: &'a Bvh, query: &'a Query, rays: &'a Rays) -> Self {
        Self { tier, tree: &bvh.tree, geometry: &bvh.geometry, query, rays }
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> Single<'a, T> {
        let lane = self.query.lane(i);
        Single::new(self.tier, (self.tree, self.geometry), lane, self.rays)
    }

    /// Visits all leaves that the rays in `active` enter, until the visitor finishes a ray.
    #[inline(always)]
    pub fn visit(&self, active: u32, visitor: &mut impl LeafVisitor) {
        let mut paths = Paths::new();
        let mut next = [Child::node(0); LANES];
        // The node whose children a ray visits, and those still to be visited, as bits.
        let (mut nodes, mut left) = ([0; LANES], [0; LANES]);
        let mut running = active;
        while running != 0 {
            for i in Bits(running) {
                let ray = self.ray(i);
                if let ChildKind::Node(index) = next[i].kind() {
                    if left[i] != 0 {
                        paths.push(i, nodes[i], left[i]);
                    }
                    let tfar = ray.lane.value(&self.query.tfar);
                    left[i] = self.tier.hit_children(&self.tree.nodes[index], &ray.lane, tfar);
                    nodes[i] = index as u32;
                } else if visitor.visit(&ray, next[i]) {
                    running &= !(1 << i);
                    continue;
                }
                if left[i] == 0 {
                    let Some(step) = paths.pop(i) else {
                        running &= !(1 << i);
                        continue;
                    };
                    (nodes[i], left[i]) = step;
                }
                next[i] = self.tree.nodes[nodes[i] as usize].first(left[i]);
                left[i] &= left[i] - 1;
                self.tree.prefetch(next[i]);
            }
        }
    }

    /// Finds the closest hits of the rays in `active`, [`TOGETHER`] at a time.
    #[inline(always)]
    fn closest(&self, active: u32, found: &mut ClosestHits) {
        let mut stacks = [const { Stack::new() }; TOGETHER];
        let mut turns = [Turn::IDLE; TOGETHER];
        let (mut waiting, mut running) = (Bits(active), 0);
        for slot in 0..TOGETHER {
            if let Some(i) = waiting.next() {
                turns[slot] = self.start(i);
                running |= 1 << slot;
            }
        }
        while running != 0 {
            for slot in Bits(running) {
                let (turn, stack) = (&mut turns[slot % TOGETHER], &mut stacks[slot % TOGETHER]);
                let ray = self.ray(turn.lane);
                if let ChildKind::Node(index) = turn.next.kind() {
                    let (node, tfar) = (&self.tree.nodes[index], turn.best.tfar);
                    turn.next = self.tier.first_in_order(node, &ray.lane, tfar, stack);
                } else {
                    ray.closest_in_leaf(turn.next, &mut turn.best);
                    turn.next = Child::EMPTY;
                }
                while turn.next == Child::EMPTY {
                    if let Some((later, distance)) = stack.pop() {
                        turn.next = if distance > turn.best.tfar { Child::EMPTY } else { later };
                        continue;
                    }
                    turn.best.store(found, turn.lane);
                    let Some(i) = waiting.next() else {
                        running &= !(1 << slot);
                        break;
                    };
                    *turn = self.start(i);
                }
                self.tree.prefetch(turn.next);
            }
        }
    }

    /// The state of ray `i` before its first visit.
    #[inline(always)]
    fn start(&self, i: usize) -> Turn {
        Turn { lane: i, next: Child::node(0), best: self.ray(i).no_hit() }
    }
}

/// A ray between two visits of its closest-hit traversal.
#[derive(Clone, Copy)]
struct Turn {
    lane: usize,
    /// What the ray visits next.
    next: Child,
    best: ClosestHit,
}

impl Turn {
    const IDLE: Self = Self { lane: 0, next: Child::EMPTY, best: ClosestHit::NONE };
}
