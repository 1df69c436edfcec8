//! Access to single kernels of the tree, for `benches/kernels.rs`.

use super::exact::{Ray64, ShearedTriangle};
use super::query::{Lane, Query};
use super::simd::{self, Stack, Tier};
use super::tree::Bvh;
use crate::ray::Rays;
use crate::simd::Kernel;

/// Number of nodes, leaves or triangles per call. Few enough for the cache.
pub const COUNT: usize = 256;

/// The kernel to run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    /// A ray against the 16 boxes of a node, with the hits in the order of the ray's octant.
    Node,
    /// A ray against the 16 triangles of a leaf: the candidates.
    Leaf,
    /// A ray against one triangle: the exact decision and t.
    Exact,
}

impl Bvh<'_> {
    /// Runs a kernel for ray 0 on [`COUNT`] nodes, leaves or triangles, repeating them if the tree
    /// has fewer. Returns a checksum of the results.
    ///
    /// # Panics
    /// If the tree has no leaf of triangles, except for [`Which::Node`].
    pub fn run_kernel(&self, which: Which, rays: &Rays) -> f64 {
        let bvh = self;
        with_tier!(self.isa, tier => tier.run(KernelRun { tier, bvh, which, rays }));
    }
}

struct KernelRun<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    which: Which,
    rays: &'a Rays,
}

impl<T: Tier> Kernel for KernelRun<'_, T> {
    type Output = f64;
    #[inline(always)]
    fn run(self) -> f64 {
        let query = Query::new(self.rays, &self.bvh.tree.bounds);
        let lane = query.lane(0);
        match self.which {
            Which::Node => self.nodes(&lane),
            Which::Leaf => self.leaves(&lane),
            Which::Exact => self.triangles(&lane),
        }
    }
}

impl<T: Tier> KernelRun<'_, T> {
    #[inline(always)]
    fn nodes(&self, lane: &Lane) -> f64 {
        let mut stack = Stack::new();
        let mut sum = 0;
        for node in self.bvh.tree.nodes.iter().cycle().take(COUNT) {
            sum ^= self.tier.first_in_order(node, lane, f32::INFINITY, &mut stack).0;
            while let Some((child, _)) = stack.pop() {
                sum ^= child.0;
            }
        }
        sum.into()
    }

    #[inline(always)]
    fn leaves(&self, lane: &Lane) -> f64 {
        let blocks = &self.bvh.tree.blocks;
        assert!(!blocks.is_empty());
        let mut sum = 0;
        // A loop, because a closure would be compiled for the portable instruction set.
        for block in blocks.iter().cycle().take(COUNT) {
            sum ^= self.tier.candidates(block, lane, f32::INFINITY).maybe;
        }
        sum.into()
    }

    #[inline(always)]
    fn triangles(&self, lane: &Lane) -> f64 {
        let blocks = &self.bvh.tree.blocks;
        assert!(!blocks.is_empty());
        let ray = Ray64::new(self.rays, 0, lane.axes[2]);
        let mut sum = 0.0;
        for block in blocks.iter().cycle().take(COUNT) {
            let seen = ShearedTriangle::new(lane, block, 0);
            let t = seen.t(&ray, block.triangle(0));
            sum += if seen.inside() { t } else { 0.0 };
        }
        sum
    }
}
