//! Finds the triangles and quads near a point.

use super::build::Tree;
use super::node::{Child, ChildKind, WIDTH};
use super::tree::Bvh;
use crate::geometry::{Nearby, doubles};

impl Bvh<'_> {
    /// Calls `found` for all triangles of the leaves whose boxes are near: see
    /// [`crate::accel::Accelerator::near`].
    pub(super) fn near_in_tree(&self, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let is_near = |bounds: [[f32; 3]; 2]| nearby.reach(bounds.map(doubles)).is_some();
        for id in near_in(&self.tree, is_near, found) {
            if let Some(index) = self.geometry.instance_in_leaf(id) {
                self.near_in_instance(index, nearby, found);
            }
        }
    }

    fn near_in_instance(&self, index: usize, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let instance = &self.geometry.instances[index];
        let first = self.geometry.bases()[self.geometry.instance_id(index) as usize];
        let nearby = nearby.within(instance.bounds.map(doubles));
        let [low, high] = instance.placement.bounds_in_mesh(nearby.bounds().map(doubles));
        let overlaps = |[below, above]: [[f32; 3]; 2]| {
            doubles(below).cmple(high).all() && doubles(above).cmpge(low).all()
        };
        let tree = &self.tree.shared[instance.mesh];
        near_in(tree, overlaps, &mut |triangle| found(first + triangle));
    }
}

/// Calls `found` for all triangles of the leaves of a tree whose boxes are near. Returns the
/// indices in the leaves of spheres.
fn near_in(
    tree: &Tree,
    is_near: impl Fn([[f32; 3]; 2]) -> bool,
    found: &mut dyn FnMut(u32),
) -> Vec<u32> {
    let mut spheres = Vec::new();
    let mut stack = vec![Child::node(0)];
    while let Some(child) = stack.pop() {
        match child.kind() {
            ChildKind::Node(index) => {
                let node = &tree.nodes[index];
                let bounds =
                    |i: usize| [0, 3].map(|k| [0, 1, 2].map(|axis| node.planes[k + axis][i]));
                let reached = (0..WIDTH).filter(|&i| is_near(bounds(i)));
                stack.extend(reached.map(|i| node.children[i]));
            }
            ChildKind::Triangles(index) => {
                let block = &tree.blocks[index];
                let present = (0..WIDTH).filter(|i| block.present >> i & 1 != 0);
                present.for_each(|i| found(tree.indices().of(block, i)));
            }
            ChildKind::Spheres(index) => spheres.extend(tree.spheres[index].0),
            ChildKind::Empty => {}
        }
    }
    spheres
}
