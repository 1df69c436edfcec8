//! Finds the triangles and quads near a box.

use super::node::{Child, ChildKind, WIDTH};
use super::tree::Bvh;
use crate::geometry::Nearby;
use crate::ray::NONE;

impl Bvh<'_> {
    /// Calls `found` for all triangles of the leaves that `nearby` overlaps: see
    /// [`crate::accel::Accelerator::near`].
    pub(super) fn near_in_tree(&self, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let [low, high] = nearby;
        let mut stack = vec![Child::node(0)];
        while let Some(child) = stack.pop() {
            match child.kind() {
                ChildKind::Node(index) => {
                    let node = &self.tree.nodes[index];
                    let mut reached = [true; WIDTH];
                    for axis in 0..3 {
                        for i in 0..WIDTH {
                            reached[i] &= (node.planes[axis][i] <= high[axis])
                                & (node.planes[axis + 3][i] >= low[axis]);
                        }
                    }
                    stack.extend((0..WIDTH).filter(|&i| reached[i]).map(|i| node.children[i]));
                }
                ChildKind::Triangles(index) => {
                    let primitives = self.tree.blocks[index].primitives;
                    let all = primitives.into_iter().filter(|&primitive| primitive != NONE);
                    all.for_each(&mut *found);
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
    }
}
