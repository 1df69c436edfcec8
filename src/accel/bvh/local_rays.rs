//! Rays in the coordinates of the mesh of an instance.

use super::build::Tree;
use super::node::{Block, Indices};
use super::query::Query;
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
