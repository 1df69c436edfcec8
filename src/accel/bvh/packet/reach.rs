//! Whether the hull of a packet reaches anything.

use super::{Bits, Packet};
use crate::accel::bvh::node::{Child, Kind};
use crate::accel::bvh::simd::{Stack, Tier};

impl<T: Tier> Packet<'_, T> {
    /// Whether a leaf may have something within the frustum; of triangles only if not all corners
    /// are on one side of it.
    ///
    /// That holds for every ray between those of the packet if they leave one point: its slope is
    /// between theirs, as a quotient of linear functions of the factors has its extremes at the
    /// corners, and rounding moves either by 3u at most: 6u max|v - o| together, of some 20u that
    /// the frustum's slack has left.
    #[inline(always)]
    pub fn reaches(&self) -> bool {
        let mut stack = Stack::new();
        stack.push(Child::node(0), 0.0);
        while let Some((child, _)) = stack.pop() {
            match child.kind() {
                Kind::Node(index) => {
                    let node = &self.tree.nodes[index];
                    for place in Bits(self.tier.overlaps(node, &self.frustum, self.end)) {
                        stack.push(node.children[node.ordered(self.frustum.octant, place)], 0.0);
                    }
                }
                Kind::Triangles(index) => {
                    let block = &self.tree.blocks[index];
                    if self.tier.overlapping(block, &self.frustum, self.end) != 0 {
                        return true;
                    }
                }
                Kind::Spheres(_) => return true,
                Kind::Empty => {}
            }
        }
        false
    }
}
