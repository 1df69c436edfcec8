//! What traversal costs, counted by a tier that passes everything on to another one.

use std::cell::Cell;

use super::node::{Block, Node, WIDTH};
use super::query::{Bundle, Lane, Slabs};
use super::simd::{Candidates, Stack, Tier};
use crate::simd::Kernel;

/// Nodes, leaves and triangles that were tested.
#[derive(Debug, Default)]
pub struct Counts {
    /// Wide nodes.
    pub nodes: Cell<u64>,
    /// Leaves of triangles.
    pub blocks: Cell<u64>,
    /// Triangles in them.
    pub triangles: Cell<u64>,
    /// Triangles decided exactly.
    pub candidates: Cell<u64>,
}

fn add(cell: &Cell<u64>, n: u32) {
    cell.set(cell.get() + u64::from(n));
}

/// A tier that counts.
#[derive(Clone, Copy)]
pub struct Counting<'c, T> {
    /// The tier that works.
    pub tier: T,
    /// What it did.
    pub counts: &'c Counts,
}

impl<T: Tier> Tier for Counting<'_, T> {
    const FUSED: bool = T::FUSED;

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        self.tier.run(kernel)
    }

    fn push_ordered(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) {
        add(&self.counts.nodes, 1);
        self.tier.push_ordered(node, lane, tfar, stack);
    }

    fn push_any(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) {
        add(&self.counts.nodes, 1);
        self.tier.push_any(node, lane, tfar, stack);
    }

    fn overlaps(self, node: &Node, slabs: &Slabs, tfar: f32) -> u32 {
        add(&self.counts.nodes, 1);
        self.tier.overlaps(node, slabs, tfar)
    }

    fn overlapping(self, block: &Block, bundle: &Bundle) -> u32 {
        let found = self.tier.overlapping(block, bundle);
        add(&self.counts.blocks, 1);
        add(&self.counts.triangles, block.present.count_ones());
        add(&self.counts.candidates, found.count_ones());
        found
    }

    fn least(self, v: &[f32; WIDTH]) -> f32 {
        self.tier.least(v)
    }

    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        let found = self.tier.candidates(block, lane, tfar);
        add(&self.counts.blocks, 1);
        add(&self.counts.triangles, block.present.count_ones());
        add(&self.counts.candidates, found.maybe.count_ones());
        found
    }
}
