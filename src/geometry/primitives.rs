//! The list of all primitives of a scene, and their scene-wide indices.

use glam::DVec3;

use super::doubles::doubles;
use super::mesh::TriangleMesh;
use super::placement::{Instance, Placement};
use super::quad::quad_halves;
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    const QUAD: [[f32; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    fn mesh(triangles: usize) -> TriangleMesh {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]];
        TriangleMesh::new(vertices, vec![[0, 1, 2]; triangles], false)
    }

    /// Two meshes of 2 and 3 triangles, two quads and three spheres.
    fn plain() -> Geometry {
        let spheres = vec![Sphere { center: DVec3::ZERO, radius: 1.0 }; 3];
        Geometry::new(DVec3::ZERO, vec![mesh(2), mesh(3)], vec![QUAD; 2], spheres).unwrap()
    }

    fn only(mesh: TriangleMesh) -> Geometry {
        Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap()
    }

    fn moved(mesh: usize, x: f64) -> Instance {
        let placement = Placement::new(DMat3::IDENTITY, DVec3::X * x);
        Instance::new(mesh, placement, [DVec3::ZERO, DVec3::ONE])
    }

    /// [`plain`] with two instances of a mesh of 4 triangles.
    fn placed() -> Geometry {
        plain().with_instances(vec![only(mesh(4))], vec![moved(0, 2.0), moved(0, 3.0)]).unwrap()
    }

    #[test]
    fn ids_follow_meshes_quads_spheres_instances() {
        let all = placed();
        let kinds = [
            GeometryKind::Mesh(0),
            GeometryKind::Mesh(1),
            GeometryKind::Quads,
            GeometryKind::Spheres,
            GeometryKind::Instance(0),
            GeometryKind::Instance(1),
        ];
        assert_eq!([0, 1, 2, 3, 4, 5].map(|geom| all.kind(geom)), kinds);
        assert_eq!((all.quads_id(), all.spheres_id()), (2, 3));
        assert_eq!((all.instance_id(0), all.instance_id(1)), (4, 5));
        assert_eq!(only(mesh(1)).instance_id(0), 3);
        assert_eq!(all.bases(), [0, 2, 5, 7, 10, 14, 18]);
        assert_eq!((all.own_count(), all.count()), (10, 18));
        let leaf = [0, 2, 3, 4, 5, NONE].map(|id| all.instance_in_leaf(id));
        assert_eq!(leaf, [None, None, Some(0), Some(1), None, None]);
        let triangles = [0, 1, 2, 3, 4, 5].map(|geom| {
            all.mesh(geom).map(|(mesh, place)| (mesh.triangles().len(), place.is_some()))
        });
        let (own, shared) = ([Some((2, false)), Some((3, false))], Some((4, true)));
        assert_eq!(triangles, [own[0], own[1], None, None, shared, shared]);
        assert_eq!(all.instance_corners(1, 3), [[3.0, 0.0, 0.0], [4.0, 0.0, 0.0], [3.0, 1.0, 0.0]]);
    }

    #[test]
    fn place_is_the_inverse_of_primitive() {
        let all = placed();
        let mut places = (0u32..)
            .zip([2, 3, 2, 3, 4, 4])
            .flat_map(|(geom, count)| (0..count).map(move |prim| (geom, prim)));
        for index in 0..18 {
            let (geom, prim) = places.next().unwrap();
            assert_eq!((all.place(index), all.primitive(geom, prim)), ((geom, prim), index));
        }
    }

    #[test]
    fn copies_have_the_last_numbers() {
        let mut all = plain();
        let numbers = |all: &Geometry| (0..10).map(|i| all.number(i)).collect::<Vec<_>>();
        assert_eq!(numbers(&all), [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
        all.copies = 1;
        assert_eq!(numbers(&all), [1, 2, 8, 9, 10, 3, 4, 5, 6, 7]);
        assert_eq!(placed().number(17), 18);
    }

    #[test]
    fn each_distinct_set_of_primitives_has_an_accelerator() {
        let mut first = Unseen::NONE;
        first.push(0..2);
        let unseen = [Unseen::NONE, first.clone(), Unseen::NONE];
        let all = placed().with_unseen(unseen);
        assert_eq!(
            (all.unseen(RayKind::Camera), all.unseen(RayKind::Shadow)),
            (&Unseen::NONE, &first)
        );
        // 10 primitives or 8 of them, with 4 shared triangles and 2 instances.
        assert_eq!(all.accelerated().primitives, 16 + 14);
        assert_eq!(placed().accelerated().primitives, 16);
        assert_eq!(all.accelerated().loose_vertices, 2 * placed().accelerated().loose_vertices);
    }

    #[test]
    fn memory_is_that_of_all_arrays() {
        let sizes = [(2, size_of::<Instance>()), (2, size_of_val(&QUAD)), (3, size_of::<Sphere>())];
        let arrays: usize = sizes.iter().map(|(count, size)| count * size).sum();
        let meshes: u64 = [2, 3, 4].map(|triangles| mesh(triangles).bytes()).iter().sum();
        assert_eq!(placed().bytes(), meshes + arrays as u64);
    }

    #[test]
    fn instances_end_below_the_last_index() {
        let instances = |count| vec![moved(0, 0.0); count];
        let with = |count| only(mesh(0)).with_instances(vec![only(mesh(65_537))], instances(count));
        assert_eq!(with(65_534).unwrap().count(), 65_537 * 65_534);
        assert_eq!(with(65_535).unwrap_err(), u64::from(NONE));
    }

    #[test]
    fn stitches_of_shared_meshes_and_of_own_ones_count() {
        let stitched = || only(mesh(1).with_stitches(&[[0, 3, 1]]));
        let with =
            |own: Geometry, shared| own.with_instances(vec![shared], vec![]).unwrap().stitched;
        assert!(with(stitched(), only(mesh(1))) && with(only(mesh(1)), stitched()));
        assert!(!with(only(mesh(1)), only(mesh(1))));
    }

    #[test]
    fn a_quad_has_two_halves() {
        let all = plain();
        let [first, second] = [[QUAD[0], QUAD[1], QUAD[3]], [QUAD[2], QUAD[3], QUAD[1]]];
        assert_eq!(all.quad_half(1, 0.25, 0.5), (first, 0.25, 0.5));
        assert_eq!(all.quad_half(1, 0.25, 0.75), (first, 0.25, 0.75));
        assert_eq!(all.quad_half(1, 0.75, 0.5), (second, 0.25, 0.5));
        let halves: Vec<_> = all.triangles(all.quads_id(), 1).collect();
        assert_eq!(halves, [(first.map(doubles), false), (second.map(doubles), true)]);
        assert_eq!(all.triangles(all.spheres_id(), 0).count(), 0);
    }
}
