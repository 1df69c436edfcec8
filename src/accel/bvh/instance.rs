//! Instances: traversal of a tree that several placed copies of a mesh share.
//!
//! The boxes of the tree are tested in the coordinates of the mesh, with rays that are transformed
//! in f64 and rounded to f32. Their slack covers that rounding. The triangles are placed in the
//! scene first and tested there with the scene's rays, so [`super::exact`] decides as for any other
//! mesh. An instance is watertight for the same reason. Only tests of boxes depend on its
//! transform.

use super::local_rays::LocalRays;
use super::node::{Child, ChildKind};
use super::simd::{Path, Stack, Tier};
use super::single::{ClosestHit, Single};
use crate::ray::LANES;
use crate::simd::Kernel;

// The tests are separate kernels, because most scenes have no instances.
impl<T: Tier> Single<'_, T> {
    /// Updates the closest hit with an instance.
    #[inline(never)]
    pub fn closest_in_instance(&self, instance: usize, best: &mut ClosestHit) {
        let local = self.tier.run(MakeLocal { single: self, instance });
        self.closest_in_copy(&local, best);
    }

    /// [`Single::closest_in_instance`] with the rays in the coordinates of the instance's mesh.
    #[inline(never)]
    pub fn closest_in_copy(&self, local: &LocalRays, best: &mut ClosestHit) {
        self.tier.run(Closest { single: self, local, best });
    }

    /// Returns whether the ray hits any triangle of an instance.
    #[inline(never)]
    pub fn any_in_instance(&self, instance: usize) -> bool {
        let local = self.tier.run(MakeLocal { single: self, instance });
        self.any_in_copy(&local)
    }

    /// [`Single::any_in_instance`] with the rays in the coordinates of the instance's mesh.
    #[inline(never)]
    pub fn any_in_copy(&self, local: &LocalRays) -> bool {
        self.tier.run(Any { single: self, local })
    }
}

struct MakeLocal<'s, 'a, T> {
    single: &'s Single<'a, T>,
    instance: usize,
}

impl<'a, T: Tier> Kernel for MakeLocal<'_, 'a, T> {
    type Output = LocalRays<'a>;
    #[inline(always)]
    fn run(self) -> LocalRays<'a> {
        self.single.local_rays(self.instance)
    }
}

struct Closest<'s, 'a, T> {
    single: &'s Single<'a, T>,
    local: &'s LocalRays<'s>,
    best: &'s mut ClosestHit,
}

impl<T: Tier> Kernel for Closest<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { single, local, best } = self;
        let (i, tree) = (single.lane.i % LANES, local.tree);
        let lane = local.query.lane(i);
        let mut stack = Stack::new();
        let mut tfar = local.tfar(i, best.t, best.primitive);
        let mut child = Child::node(0);
        loop {
            match child.kind() {
                ChildKind::Node(index) => {
                    child = single.tier.first_in_order(&tree.nodes[index], &lane, tfar, &mut stack);
                    if let Some(later) = stack.last() {
                        tree.prefetch_if_large(later);
                    }
                    if child != Child::EMPTY {
                        continue;
                    }
                }
                ChildKind::Triangles(index) => {
                    single.closest_in_block(&local.block(index), local.indices(), best);
                    tfar = local.tfar(i, best.t, best.primitive);
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
            child = loop {
                let Some((next, distance)) = stack.pop() else { return };
                if distance <= tfar {
                    break next;
                }
            };
        }
    }
}

struct Any<'s, 'a, T> {
    single: &'s Single<'a, T>,
    local: &'s LocalRays<'s>,
}

impl<T: Tier> Kernel for Any<'_, '_, T> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let Self { single, local } = self;
        let (i, tree) = (single.lane.i % LANES, local.tree);
        let (lane, tfar) = (local.query.lane(i), local.query.tfar[i]);
        let mut path = Path::new();
        let (mut index, mut left) = (0, single.tier.hit_children(&tree.nodes[0], &lane, tfar));
        loop {
            while left == 0 {
                let Some(step) = path.pop() else { return false };
                (index, left) = step;
            }
            let child = tree.nodes[index].first(left);
            left &= left - 1;
            match child.kind() {
                ChildKind::Node(below) => {
                    if left != 0 {
                        path.push(index, left);
                    }
                    index = below;
                    left = single.tier.hit_children(&tree.nodes[index], &lane, tfar);
                }
                ChildKind::Triangles(block)
                    if single.any_in_block(&local.block(block), local.indices()) =>
                {
                    return true;
                }
                _ => {}
            }
        }
    }
}
