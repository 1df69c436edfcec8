//! Finds the triangles that a segment may hit: candidates for an exact test.

use super::node::ChildKind;
use super::query::Query;
use super::simd::{self, Path, Tier};
use super::tree::Bvh;
use crate::ray::Rays;
use crate::simd::Kernel;

impl Bvh<'_> {
    /// Returns whether `hits` is true for any triangle of the leaves that ray 0 of `rays` reaches.
    /// `hits` gets scene-wide primitive indices. Spheres are ignored.
    ///
    /// The ray may be a segment between f64 points, rounded to f32. The traversal widens boxes by
    /// 64u max|v - o| (u = 2^-24) for the test of [`super::exact`]: see [`Query`]. A test of the
    /// f64 segment does not need this slack. The rounding of origin, direction and vertices takes
    /// less than 20u of it.
    pub fn any_near(&self, rays: &Rays, hits: &mut dyn FnMut(u32) -> bool) -> bool {
        let bvh = self;
        with_tier!(self.isa, tier => tier.run(AnyNear { tier, bvh, rays, hits }));
    }
}

struct AnyNear<'a, 'h, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    rays: &'a Rays,
    hits: &'h mut dyn FnMut(u32) -> bool,
}

impl<T: Tier> Kernel for AnyNear<'_, '_, T> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let Self { tier, bvh, rays, hits } = self;
        let query = Query::new(rays, &bvh.tree.bounds);
        let (lane, mut path) = (query.lane(0), Path::new());
        let tfar = lane.value(&query.tfar);
        let mut index = 0;
        let mut left = tier.hit_children(&bvh.tree.nodes[index], &lane, tfar);
        loop {
            while left == 0 {
                let Some(step) = path.pop() else { return false };
                (index, left) = step;
            }
            let child = bvh.tree.nodes[index].first(left);
            left &= left - 1;
            match child.kind() {
                ChildKind::Node(below) => {
                    if left != 0 {
                        path.push(index, left);
                    }
                    index = below;
                    left = tier.hit_children(&bvh.tree.nodes[index], &lane, tfar);
                }
                ChildKind::Triangles(block) => {
                    let block = &bvh.tree.blocks[block];
                    let mut slots = u32::from(block.present);
                    while slots != 0 {
                        let slot = slots.trailing_zeros() as usize;
                        slots &= slots - 1;
                        if hits(bvh.tree.indices().of(block, slot)) {
                            return true;
                        }
                    }
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }
}
