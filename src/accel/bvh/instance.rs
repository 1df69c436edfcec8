//! Instances: traversal of a tree that several placed copies of a mesh share.
//!
//! The boxes of the tree are tested in the coordinates of the mesh, with rays that are transformed
//! in f64 and rounded to f32. Their slack covers that rounding. The triangles are placed in the
//! scene first and tested there with the scene's rays, so [`super::exact`] decides as for any other
//! mesh. An instance is watertight for the same reason, and no test depends on its transform.

use super::build::Tree;
use super::node::{Block, Child, ChildKind, Indices};
use super::query::Query;
use super::simd::{Path, Stack, Tier};
use super::single::{ClosestHit, Single};
use crate::geometry::{Geometry, Instance};
use crate::ray::{LANES, NONE, Rays};

/// An instance, and 16 rays in the coordinates of its mesh.
pub struct LocalRays<'a> {
    pub tree: &'a Tree,
    /// The mesh of the instance.
    pub geometry: &'a Geometry,
    instance: &'a Instance,
    /// Scene-wide index of the first triangle of the instance.
    first: u32,
    pub rays: Rays,
    pub query: Query,
}

impl<'a> LocalRays<'a> {
    /// Transforms the rays of `query`, for the instance with this index.
    ///
    /// A ray that hits a triangle in the scene passes it within [`Query::box_slack`] of the scene,
    /// unless the angle between ray and triangle is below some 6 degrees; then the line does. The
    /// vertices of the triangle were rounded by half an ulp. In the coordinates of the mesh both
    /// are larger by the norm of the inverse transform. The rounding of the transformed ray is that
    /// of a ray of the mesh: [`Query`] includes it.
    #[inline(always)]
    pub fn new(
        (tree, geometry): (&'a Tree, &'a Geometry),
        index: usize,
        query: &Query,
        rays: &Rays,
    ) -> Self {
        let instance = &geometry.instances[index];
        let placement = &instance.placement;
        let (norm, rounding) = (placement.inverse_norm(), 2.0 * f32::EPSILON * instance.reach());
        let mut local = Rays { tnear: rays.tnear, tfar: rays.tfar, ..Rays::EMPTY };
        let mut slack = [0.0; LANES];
        let ([ox, oy, oz], [dx, dy, dz]) = (&rays.org, &rays.dir);
        for i in 0..LANES {
            let origin = [f64::from(ox[i]), f64::from(oy[i]), f64::from(oz[i])];
            let direction = [f64::from(dx[i]), f64::from(dy[i]), f64::from(dz[i])];
            let origin = placement.to_mesh(origin.into()).as_vec3().to_array();
            let direction = placement.vector_to_mesh(direction.into()).as_vec3().to_array();
            for axis in 0..3 {
                local.org[axis][i] = origin[axis];
                local.dir[axis][i] = direction[axis];
            }
            slack[i] = (norm * f64::from(1.01 * (query.box_slack[i] + rounding))) as f32;
        }
        let tree = &tree.shared[instance.mesh];
        let first = geometry.bases()[geometry.instance_id(index) as usize];
        let query = Query::with_slack(&local, &tree.bounds, &slack);
        let geometry = &geometry.shared[instance.mesh];
        Self { tree, geometry, instance, first, rays: local, query }
    }

    /// Returns a leaf of the tree, placed in the scene.
    #[inline(always)]
    pub fn block(&self, index: usize) -> Block {
        let mut block = self.tree.blocks[index].clone();
        block.vertices = self.instance.placement.place_lanes(block.vertices);
        block
    }

    /// Returns what finds the scene-wide indices of the triangles in leaves.
    #[inline(always)]
    pub fn indices(&self) -> Indices<'_> {
        Indices { first: self.first, ..self.tree.indices() }
    }

    /// Returns the end of ray `i` for tests of boxes: at its closest hit so far, if it has one.
    #[inline(always)]
    pub fn tfar(&self, i: usize, t: f64, primitive: u32) -> f32 {
        if primitive == NONE { self.query.tfar[i] } else { self.query.tfar_for_hit(i, t) }
    }
}

impl<T: Tier> Single<'_, T> {
    /// Updates the closest hit with an instance.
    #[inline(never)]
    pub fn closest_in_instance(&self, instance: usize, best: &mut ClosestHit) {
        let local = self.local_rays(instance);
        let (i, tree) = (self.lane.i % LANES, local.tree);
        let lane = local.query.lane(i);
        let mut stack = Stack::new();
        let mut tfar = local.tfar(i, best.t, best.primitive);
        let mut child = Child::node(0);
        loop {
            match child.kind() {
                ChildKind::Node(index) => {
                    child = self.tier.first_in_order(&tree.nodes[index], &lane, tfar, &mut stack);
                    if let Some(later) = stack.last() {
                        tree.prefetch(later);
                    }
                    if child != Child::EMPTY {
                        continue;
                    }
                }
                ChildKind::Triangles(index) => {
                    self.closest_in_block(&local.block(index), local.indices(), best);
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

    /// Returns whether the ray hits any triangle of an instance.
    #[inline(never)]
    pub fn any_in_instance(&self, instance: usize) -> bool {
        let local = self.local_rays(instance);
        let (i, tree) = (self.lane.i % LANES, local.tree);
        let (lane, tfar) = (local.query.lane(i), local.query.tfar[i]);
        let mut path = Path::new();
        let (mut index, mut left) = (0, self.tier.hit_children(&tree.nodes[0], &lane, tfar));
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
                    left = self.tier.hit_children(&tree.nodes[index], &lane, tfar);
                }
                ChildKind::Triangles(block)
                    if self.any_in_block(&local.block(block), local.indices()) =>
                {
                    return true;
                }
                _ => {}
            }
        }
    }
}
