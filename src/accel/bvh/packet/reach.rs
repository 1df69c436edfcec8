//! Conservative test whether the convex hull of a packet contains anything.

use super::{Bits, Packet};
use crate::accel::bvh::node::{Child, ChildKind};
use crate::accel::bvh::simd::{Stack, Tier};

impl<T: Tier> Packet<'_, T> {
    /// Returns false only if no primitive lies inside the frustum. A triangle counts as outside if
    /// all its corners lie outside one plane of the frustum. A leaf of spheres counts as inside if
    /// the frustum overlaps its box.
    ///
    /// The result also holds for every ray inside the cone that the rays of the packet span, if all
    /// rays share one origin:
    ///
    /// - The direction of such a ray is a sum of the packet's directions with factors >= 0. Its
    ///   slope is a quotient of linear functions of the factors. So its extremes are at the
    ///   corners: the slope lies between those of the packet's rays.
    /// - Rounding moves each of the two slopes by at most 3u (u = 2^-24). Together this is 6u
    ///   max|v - o|. The frustum's slack has some 20u left for it.
    #[inline(always)]
    pub fn may_contain_anything(&self) -> bool {
        let mut stack = Stack::new();
        stack.push(Child::node(0), 0.0);
        while let Some((child, _)) = stack.pop() {
            match child.kind() {
                ChildKind::Node(index) => {
                    let node = &self.tree.nodes[index];
                    for place in
                        Bits(self.tier.children_in_frustum(node, &self.frustum, self.end_depth))
                    {
                        stack.push(node.children[node.ordered(self.frustum.octant, place)], 0.0);
                    }
                }
                ChildKind::Triangles(index) => {
                    let block = &self.tree.blocks[index];
                    if self.tier.triangles_in_frustum(block, &self.frustum, self.end_depth) != 0 {
                        return true;
                    }
                }
                ChildKind::Spheres(_) => return true,
                ChildKind::Empty => {}
            }
        }
        false
    }
}
