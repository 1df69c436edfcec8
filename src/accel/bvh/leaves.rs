//! The leaves that a frustum overlaps.

use super::build::Tree;
use super::frustum::Frustum;
use super::node::{Child, ChildKind};
use super::packet::Bits;
use super::simd::{Stack, Tier};

/// A leaf that a frustum overlaps.
pub enum Leaf {
    /// Index of a block, and its triangles that are not outside one plane of the frustum, as bits.
    /// At least one bit is set.
    Triangles(usize, u32),
    /// A leaf of spheres or of an instance.
    Spheres,
}

/// Iterator over the leaves of a tree that a frustum overlaps, from the start of the frustum to its
/// end.
pub struct Leaves<'a, T> {
    tier: T,
    tree: &'a Tree,
    frustum: &'a Frustum,
    /// Where the frustum ends: see [`Frustum::end_depth`].
    end: f32,
    stack: Stack,
}

impl<'a, T: Tier> Leaves<'a, T> {
    /// Starts at the root.
    #[inline(always)]
    pub fn new(tier: T, tree: &'a Tree, (frustum, end): (&'a Frustum, f32)) -> Self {
        let mut stack = Stack::new();
        stack.push(Child::node(0), 0.0);
        Self { tier, tree, frustum, end, stack }
    }
}

impl<T: Tier> Iterator for Leaves<'_, T> {
    type Item = Leaf;

    #[inline(always)]
    fn next(&mut self) -> Option<Leaf> {
        while let Some((child, _)) = self.stack.pop() {
            match child.kind() {
                ChildKind::Node(index) => {
                    let node = &self.tree.nodes[index];
                    for place in Bits(self.tier.children_in_frustum(node, self.frustum, self.end)) {
                        let child = node.children[node.ordered(self.frustum.octant, place)];
                        self.stack.push(child, 0.0);
                    }
                }
                ChildKind::Triangles(index) => {
                    let block = &self.tree.blocks[index];
                    let triangles = self.tier.triangles_in_frustum(block, self.frustum, self.end);
                    if triangles != 0 {
                        return Some(Leaf::Triangles(index, triangles));
                    }
                }
                ChildKind::Spheres(_) => return Some(Leaf::Spheres),
                ChildKind::Empty => {}
            }
        }
        None
    }
}
