//! The list of all primitives of a scene, and their scene-wide indices.

use glam::DVec3;

use super::mesh::TriangleMesh;
use super::sphere::Sphere;
use super::unseen::Unseen;
use crate::ray::{NONE, RayKind};

/// All primitives of a scene. The meshes have the first geometry ids, in order. One id for all
/// quads and one for all spheres follow, even if there are none.
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
}

/// Splits a quad into its two triangles.
#[inline(always)]
pub fn quad_halves<T: Copy>([v0, v1, v2, v3]: [T; 4]) -> [[T; 3]; 2] {
    [[v0, v1, v3], [v2, v3, v1]]
}

/// Converts a point to f64.
#[inline(always)]
pub fn doubles(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
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
        Ok(Self { origin, meshes, quads, spheres, bases, stitched, unseen })
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
    /// hit.
    pub fn accelerated(&self) -> u64 {
        let all = 0..self.count() as u32;
        let distinct =
            (0..self.unseen.len()).filter(|&k| !self.unseen[..k].contains(&self.unseen[k]));
        distinct.map(|k| self.count() - u64::from(self.unseen[k].count(&all))).sum()
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
            Some(_) => GeometryKind::Spheres,
        }
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
        };
        let parts = [first.zip(Some(false)), second.zip(Some(true))].into_iter().flatten();
        parts.map(|(corners, is_second)| (corners.map(doubles), is_second))
    }

    /// Memory of the primitive arrays, in bytes.
    pub fn bytes(&self) -> u64 {
        self.meshes.iter().map(TriangleMesh::bytes).sum::<u64>()
            + (size_of_val(&self.quads[..]) + size_of_val(&self.spheres[..])) as u64
    }
}
