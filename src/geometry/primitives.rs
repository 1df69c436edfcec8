//! The list of all primitives of a scene, and their scene-wide indices.

use glam::DVec3;

use super::doubles::doubles;
use super::mesh::TriangleMesh;
use super::placement::{Instance, Placement};
use super::sphere::Sphere;
use super::unseen::Unseen;
use crate::ray::{NONE, RayKind};

/// All primitives of a scene. The meshes have the first geometry ids, in order. One id for all
/// quads and one for all spheres follow, even if there are none. Then each instance has an id.
#[derive(Debug, Default)]
pub struct Geometry {
    /// World position that all coordinates are relative to.
    pub origin: DVec3,
    /// Triangle meshes; the geometry id of a mesh is its index.
    pub meshes: Vec<TriangleMesh>,
    /// Convex quads, planar up to a tolerance and rounding, corners in order.
    pub quads: Vec<[[f32; 3]; 4]>,
    /// All spheres, in f64.
    pub spheres: Vec<Sphere>,
    /// The meshes of the instances: each is the only mesh of a geometry of its own, relative to an
    /// origin of its own.
    pub shared: Vec<Geometry>,
    /// The placed copies of these meshes.
    pub instances: Vec<Instance>,
    /// Number of meshes, the last ones, that stand for an instance each.
    pub copies: usize,
    /// Scene-wide index of each geometry's first primitive, then the number of all primitives.
    bases: Vec<u32>,
    /// Whether any mesh has stitches.
    pub(super) stitched: bool,
    /// By [`RayKind`]: the primitives that such rays cannot hit.
    unseen: [Unseen; RayKind::ALL.len()],
}

/// The kind of primitive that a geometry id stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GeometryKind {
    /// A triangle mesh, with its index in [`Geometry::meshes`].
    Mesh(usize),
    /// The quads of [`Geometry::quads`]; `prim` is an index into it.
    Quads,
    /// The spheres of [`Geometry::spheres`]; `prim` is an index into it.
    Spheres,
    /// The triangles of an instance, with its index in [`Geometry::instances`].
    Instance(usize),
}

/// Splits a quad into its two triangles.
#[inline(always)]
pub fn quad_halves<T: Copy>([v0, v1, v2, v3]: [T; 4]) -> [[T; 3]; 2] {
    [[v0, v1, v3], [v2, v3, v1]]
}

impl Geometry {
    /// Creates the list and gives every primitive a scene-wide index.
    ///
    /// # Errors
    /// The number of primitives counted so far, as soon as it is not below 2^32 - 1.
    pub fn new(
        origin: DVec3,
        meshes: Vec<TriangleMesh>,
        quads: Vec<[[f32; 3]; 4]>,
        spheres: Vec<Sphere>,
    ) -> Result<Self, u64> {
        let counts = meshes.iter().map(|m| m.triangles().len()).chain([quads.len(), spheres.len()]);
        let mut total = 0u64;
        let mut bases = vec![0];
        for count in counts {
            total += count as u64;
            bases.push(u32::try_from(total).ok().filter(|&n| n < NONE).ok_or(total)?);
        }
        let stitched = meshes.iter().any(|mesh| mesh.stitches() > 0);
        let unseen = [Unseen::NONE; RayKind::ALL.len()];
        let (shared, instances, copies) = (Vec::new(), Vec::new(), 0);
        Ok(Self {
            origin,
            meshes,
            quads,
            spheres,
            shared,
            instances,
            copies,
            bases,
            stitched,
            unseen,
        })
    }

    /// The geometry with `instances` of the meshes in `shared`. Each element of `shared` has
    /// exactly one mesh and nothing else.
    ///
    /// # Errors
    /// As [`Geometry::new`].
    pub fn with_instances(
        mut self,
        shared: Vec<Geometry>,
        instances: Vec<Instance>,
    ) -> Result<Self, u64> {
        for instance in &instances {
            let total = self.count() + shared[instance.mesh].count();
            self.bases.push(u32::try_from(total).ok().filter(|&n| n < NONE).ok_or(total)?);
        }
        self.stitched |= shared.iter().any(|mesh| mesh.stitched);
        Ok(Self { shared, instances, ..self })
    }

    /// The geometry with primitives that rays of some kinds cannot hit, by [`RayKind`].
    pub fn with_unseen(self, unseen: [Unseen; RayKind::ALL.len()]) -> Self {
        Self { unseen, ..self }
    }

    /// Primitives that rays of a kind cannot hit.
    pub fn unseen(&self, kind: RayKind) -> &Unseen {
        &self.unseen[kind as usize]
    }

    /// Number of primitives in all accelerators: one for each distinct set that a kind of ray can
    /// hit. A shared mesh counts once for each accelerator, and each of its instances as one
    /// primitive.
    pub fn accelerated(&self) -> u64 {
        let own = 0..self.own_count();
        let shared = self.shared.iter().map(Geometry::count).sum::<u64>();
        let placed = shared + self.instances.len() as u64;
        let distinct =
            (0..self.unseen.len()).filter(|&k| !self.unseen[..k].contains(&self.unseen[k]));
        distinct.map(|k| u64::from(own.end - self.unseen[k].count(&own)) + placed).sum()
    }

    /// Id of the geometry that holds all quads.
    pub fn quads_id(&self) -> u32 {
        self.meshes.len() as u32
    }

    /// Id of the geometry that holds all spheres.
    pub fn spheres_id(&self) -> u32 {
        self.meshes.len() as u32 + 1
    }

    /// Returns the kind of geometry `geom`, which must not be [`NONE`].
    #[inline(always)]
    pub fn kind(&self, geom: u32) -> GeometryKind {
        match (geom as usize).checked_sub(self.meshes.len()) {
            None => GeometryKind::Mesh(geom as usize),
            Some(0) => GeometryKind::Quads,
            Some(1) => GeometryKind::Spheres,
            Some(later) => GeometryKind::Instance(later - 2),
        }
    }

    /// Returns the mesh of geometry `geom`, and the placement of an instance. `None` for quads and
    /// spheres.
    #[inline(always)]
    pub fn mesh(&self, geom: u32) -> Option<(&TriangleMesh, Option<&Placement>)> {
        match self.kind(geom) {
            GeometryKind::Mesh(mesh) => Some((&self.meshes[mesh], None)),
            GeometryKind::Instance(index) => {
                let (mesh, instance) = self.instance(index);
                Some((mesh, Some(&instance.placement)))
            }
            GeometryKind::Quads | GeometryKind::Spheres => None,
        }
    }

    /// Returns an instance and its mesh.
    #[inline(always)]
    pub fn instance(&self, index: usize) -> (&TriangleMesh, &Instance) {
        let instance = &self.instances[index];
        (&self.shared[instance.mesh].meshes[0], instance)
    }

    /// Corners of triangle `prim` of an instance, in the scene.
    #[inline(always)]
    pub fn instance_corners(&self, index: usize, prim: u32) -> [[f32; 3]; 3] {
        let (mesh, instance) = self.instance(index);
        instance.placement.corners(mesh.corners(prim))
    }

    /// Returns the index of the instance that a [sphere leaf](crate::accel::bvh) refers to by `id`.
    /// `None` for a sphere and for an unused slot.
    #[inline(always)]
    pub fn instance_in_leaf(&self, id: u32) -> Option<usize> {
        let index = (id as usize).checked_sub(self.spheres.len())?;
        (index < self.instances.len()).then_some(index)
    }

    /// Number of primitives without those of instances.
    #[inline(always)]
    pub fn own_count(&self) -> u32 {
        self.bases[self.meshes.len() + 2]
    }

    /// Geometry id of an instance.
    pub fn instance_id(&self, index: usize) -> u32 {
        (self.meshes.len() + 2 + index) as u32
    }

    /// Scene-wide index of primitive `prim` of geometry `geom`. Lower geometry ids have lower
    /// indices.
    #[inline(always)]
    pub fn primitive(&self, geom: u32, prim: u32) -> u32 {
        self.bases[geom as usize] + prim
    }

    /// Geometry id of a primitive, and its index in that geometry, by its scene-wide index. The
    /// inverse of [`Geometry::primitive`].
    #[inline(always)]
    pub fn place(&self, primitive: u32) -> (u32, u32) {
        let geom = match self.bases[1] {
            // Most scenes have one large mesh.
            first if primitive < first => 0,
            _ => self.bases.partition_point(|&base| base <= primitive) - 1,
        };
        (geom as u32, primitive - self.bases[geom])
    }

    /// Returns the number of a primitive in the layers of a picture, from 1. Instances have the
    /// last numbers, also where they are copies.
    pub fn number(&self, primitive: u32) -> u32 {
        let meshes = self.meshes.len();
        let [first, end] = [meshes - self.copies, meshes].map(|geom| self.bases[geom]);
        let others = self.own_count() - end;
        1 + match primitive {
            _ if first == end || primitive < first => primitive,
            copied if copied < end => copied + others,
            other => other - (end - first),
        }
    }

    /// Number of primitives of all geometries.
    pub fn count(&self) -> u64 {
        self.bases.last().copied().unwrap_or(0).into()
    }

    /// Scene-wide index of each geometry's first primitive, then the number of all primitives.
    pub fn bases(&self) -> &[u32] {
        &self.bases
    }

    /// Corners of the half of quad `prim` that contains the hit (`u`, `v`), and the hit's
    /// barycentrics in that half. Embree's convention: `v0 v1 v3` where u + v <= 1, else `v2 v3 v1`
    /// with 1 - u, 1 - v.
    #[inline(always)]
    pub fn quad_half(&self, prim: u32, u: f32, v: f32) -> ([[f32; 3]; 3], f32, f32) {
        let [first, second] = quad_halves(self.quads[prim as usize]);
        if u + v <= 1.0 { (first, u, v) } else { (second, 1.0 - u, 1.0 - v) }
    }

    /// Triangles of a primitive in f64: one, the two halves of a quad, or none for a sphere. The
    /// second value is true for the second half.
    pub fn triangles(&self, geom: u32, prim: u32) -> impl Iterator<Item = ([DVec3; 3], bool)> {
        let [first, second] = match self.kind(geom) {
            GeometryKind::Mesh(mesh) => [Some(self.meshes[mesh].corners(prim)), None],
            GeometryKind::Quads => quad_halves(self.quads[prim as usize]).map(Some),
            GeometryKind::Spheres => [None, None],
            GeometryKind::Instance(index) => [Some(self.instance_corners(index, prim)), None],
        };
        let parts = [first.zip(Some(false)), second.zip(Some(true))].into_iter().flatten();
        parts.map(|(corners, is_second)| (corners.map(doubles), is_second))
    }

    /// Memory of the primitive arrays, in bytes.
    pub fn bytes(&self) -> u64 {
        self.meshes.iter().map(TriangleMesh::bytes).sum::<u64>()
            + self.shared.iter().map(Geometry::bytes).sum::<u64>()
            + (size_of_val(&self.instances[..])
                + size_of_val(&self.quads[..])
                + size_of_val(&self.spheres[..])) as u64
    }
}
