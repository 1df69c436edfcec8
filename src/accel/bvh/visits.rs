//! Counts the visits of a traversal, with a [`Tier`] that forwards every call to another one.

use std::cell::Cell;

use super::frustum::{Frustum, HorizontalMin};
use super::node::{Block, Child, Node, WIDTH};
use super::query::Lane;
use super::simd::{Candidates, Stack, Tier};
use crate::accel::accelerator::Visits;
use crate::ray::Mask;
use crate::simd::Kernel;

/// Counters of the nodes and primitives that a traversal visits.
///
/// A node counts once for a whole packet, and once for each ray that is traced alone. So do all
/// triangles of a leaf, because they are tested together. Where a packet tests a leaf ray by ray,
/// they count for the packet and for each of these rays. A sphere counts once for each ray.
#[derive(Debug, Default)]
pub struct Counts {
    nodes: Cell<u64>,
    primitives: Cell<u64>,
}

impl Counts {
    /// Returns the counts so far.
    pub fn visits(&self) -> Visits {
        Visits { nodes: self.nodes.get(), primitives: self.primitives.get() }
    }

    fn add_node(&self) {
        self.nodes.set(self.nodes.get() + 1);
    }

    fn add_primitives(&self, n: u32) {
        self.primitives.set(self.primitives.get() + u64::from(n));
    }
}

/// A [`Tier`] that forwards every call to `tier`, and counts visits.
#[derive(Clone, Copy)]
pub struct Counting<'c, T> {
    pub tier: T,
    pub counts: &'c Counts,
}

impl<T: Tier> HorizontalMin for Counting<'_, T> {
    fn horizontal_min(self, v: &[f32; WIDTH]) -> f32 {
        self.tier.horizontal_min(v)
    }
}

impl<T: Tier> Tier for Counting<'_, T> {
    const FUSED: bool = T::FUSED;

    fn lesser(a: f32, b: f32) -> f32 {
        T::lesser(a, b)
    }

    fn larger(a: f32, b: f32) -> f32 {
        T::larger(a, b)
    }

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        self.tier.run(kernel)
    }

    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child {
        self.counts.add_node();
        self.tier.first_in_order(node, lane, tfar, stack)
    }

    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32 {
        self.counts.add_node();
        self.tier.hit_children(node, lane, tfar)
    }

    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32 {
        self.counts.add_node();
        self.tier.children_in_frustum(node, frustum, end)
    }

    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32 {
        self.counts.add_primitives(block.present.count_ones());
        self.tier.triangles_in_frustum(block, frustum, end)
    }

    fn bits(self, mask: &Mask) -> u32 {
        self.tier.bits(mask)
    }

    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32 {
        self.tier.at_most(a, b)
    }

    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        self.counts.add_primitives(block.present.count_ones());
        self.tier.candidates(block, lane, tfar)
    }

    fn count_sphere_test(self) {
        self.counts.add_primitives(1);
    }
}
