//! Finds the triangles and quads near a box.

use super::build::Tree;
use super::node::{Child, ChildKind, WIDTH};
use super::tree::Bvh;
use crate::geometry::{Nearby, doubles};

impl Bvh<'_> {
    /// Calls `found` for all triangles of the leaves that `nearby` overlaps: see
    /// [`crate::accel::Accelerator::near`].
    pub(super) fn near_in_tree(&self, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        for id in near_in(&self.tree, nearby, found) {
            if let Some(index) = self.geometry.instance_in_leaf(id) {
                self.near_in_instance(index, nearby, found);
            }
        }
    }

    fn near_in_instance(&self, index: usize, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let instance = &self.geometry.instances[index];
        let first = self.geometry.bases()[self.geometry.instance_id(index) as usize];
        let in_mesh = instance.placement.bounds_in_mesh(nearby.map(doubles));
        // A conversion to f32 rounds by half an ulp; the box is two ulp wider than needed.
        let in_mesh = in_mesh.map(|corner| corner.as_vec3().to_array());
        let tree = &self.tree.shared[instance.mesh];
        near_in(tree, &in_mesh, &mut |triangle| found(first + triangle));
    }
}

/// Calls `found` for all triangles of the leaves of a tree that `nearby` overlaps. Returns the
/// indices in the leaves of spheres.
fn near_in(tree: &Tree, nearby: &Nearby, found: &mut dyn FnMut(u32)) -> Vec<u32> {
    let [low, high] = nearby;
    let mut spheres = Vec::new();
    let mut stack = vec![Child::node(0)];
    while let Some(child) = stack.pop() {
        match child.kind() {
            ChildKind::Node(index) => {
                let node = &tree.nodes[index];
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
