//! Conservative test whether the convex hull of a packet hits anything.

use super::{Bits, Packet};
use crate::accel::bvh::node::{Child, ChildKind};
use crate::accel::bvh::simd::{Stack, Tier};

impl<T: Tier> Packet<'_, T> {
    /// Returns whether any leaf may contain something inside the frustum. A triangle counts only if
    /// its corners do not all lie outside the same plane of the frustum.
    ///
    /// The result also holds for every ray inside the cone that the rays of the packet span, if all
    /// rays share one origin:
    ///
    /// - The slope of such a ray lies between the slopes of the packet's rays. It is a quotient of
    ///   linear functions of the factors, so its extremes are at the corners.
    /// - Rounding moves each of the two slopes by at most 3u. Together this is 6u max|v - o|. The
    ///   frustum's slack has some 20u left for it.
    #[inline(always)]
    pub fn reaches(&self) -> bool {
        let mut stack = Stack::new();
        stack.push(Child::node(0), 0.0);
        while let Some((child, _)) = stack.pop() {
            match child.kind() {
                ChildKind::Node(index) => {
                    let node = &self.tree.nodes[index];
                    for place in Bits(self.tier.children_in_frustum(node, &self.frustum, self.end))
                    {
                        stack.push(node.children[node.ordered(self.frustum.octant, place)], 0.0);
                    }
                }
                ChildKind::Triangles(index) => {
                    let block = &self.tree.blocks[index];
                    if self.tier.triangles_in_frustum(block, &self.frustum, self.end) != 0 {
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
