//! The meshes of a caller, and the tree over them.

use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::arrays::{self, MeshArrays};
use crate::accel::bvh::{Bvh, Multipoles, OwnedBvh};
use crate::accel::{self, Accelerator, BuildInfo, BuildOptions};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::geometry::{Box3, Geometry, TriangleMesh};
use crate::memory;
use crate::monitor::{Monitor, Phase};
use crate::parallel;
use crate::reserve;
use crate::scene::{Backend, EmbreeMode};
use crate::simd::Isa;

/// What traces the rays of a [`RayScene`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RayBackend {
    /// The tree of this crate, for all queries. It is watertight: no ray slips through an edge or a
    /// vertex, unless it starts at a surface, closer than 5e-7 of the distance to the corners of a
    /// face.
    #[default]
    Bvh,
    /// Intel Embree 4, loaded at run time, for [`RayScene::closest`] and [`RayScene::occluded`]
    /// alone. Rays aimed exactly at vertices can slip through.
    Embree,
}

impl FromStr for RayBackend {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "bvh" => Ok(Self::Bvh),
            "embree" => Ok(Self::Embree),
            _ => {
                let message = format!("found `{name}`, expected `bvh` or `embree`");
                Err(Error::invalid("backend", message))
            }
        }
    }
}

/// The tree over all triangles, with their scene-wide indices and the origin.
enum SceneTree {
    Bvh(Box<OwnedBvh>),
    Embree { accelerator: Arc<dyn Accelerator>, geometry: Arc<Geometry> },
}

/// Meshes that are ready for rays and points, without camera, lights and materials.
///
/// Rays are traced by a [`RayBackend`].
/// Rays and vertices are rounded to f32 for that, relative to an origin in or near the meshes. The
/// values of a hit are computed in f64 from the caller's arrays. [`RayScene::contains`] for closed
/// meshes, and [`RayScene::visible`], decide without rounding.
///
/// Everything runs on the threads of the current rayon pool. A [`Monitor`] counts finished rays or
/// points, and can stop a query, which then returns an error.
///
/// ```
/// use lightpath::{Limits, Mesh, Monitor, Positions, RayBatch, RayScene};
///
/// # fn main() -> lightpath::Result<()> {
/// // A tetrahedron.
/// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// let mesh = Mesh::new(Positions::F64(corners), faces)?;
/// let monitor = Monitor::default();
/// let scene = RayScene::new(vec![Box::new(mesh)], &monitor)?;
///
/// let (origins, directions) = ([[0.25, 0.25, 5.0]], [[0.0, 0.0, -1.0]]);
/// let rays = RayBatch::new(&origins, &directions)?;
/// let hits = scene.closest(&rays, &monitor)?;
/// assert_eq!((hits.t[0], hits.primitive[0]), (4.5, 3));
/// let all = scene.all_hits(&rays, &monitor)?;
/// assert_eq!((all.offsets, all.t), (vec![0, 2], vec![4.5, 5.0]));
///
/// let points = [[0.1, 0.1, 0.1], [0.5, 0.5, 0.5]];
/// assert_eq!(scene.contains(&points, &monitor)?, [true, false]);
/// # Ok(())
/// # }
/// ```
pub struct RayScene {
    pub(super) meshes: Vec<Box<dyn MeshArrays>>,
    tree: SceneTree,
    /// Lower and upper corner of all triangles in the caller's coordinates.
    pub(super) bounds: [DVec3; 2],
    /// For each mesh, whether it is closed.
    pub(super) closed: OnceLock<Vec<bool>>,
    /// Multipoles of all meshes, for winding numbers.
    pub(super) multipoles: OnceLock<Multipoles>,
    /// Multipoles of the meshes that are not closed.
    pub(super) open_multipoles: OnceLock<Multipoles>,
}

impl fmt::Debug for RayScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (meshes, info) = (self.meshes.len(), self.info());
        f.debug_struct("RayScene").field("meshes", &meshes).field("tree", &info).finish()
    }
}

impl RayScene {
    /// Builds the default backend. Triangles are numbered in each mesh from 0.
    ///
    /// # Errors
    /// The errors of [`RayScene::with_backend`].
    pub fn new(meshes: Vec<Box<dyn MeshArrays>>, monitor: &Monitor) -> Result<Self> {
        Self::with_backend(meshes, RayBackend::default(), monitor)
    }

    /// Builds the acceleration structure of a backend.
    ///
    /// # Errors
    /// - `Invalid`: no mesh, a mesh without faces, an index out of range, or a vertex of a face
    ///   that is not finite or beyond 1e18.
    /// - `Limit`: more than 2^32 vertices in a mesh, more than 2^32 - 2 triangles, or 2^30 - 1 for
    ///   [`RayBackend::Bvh`].
    /// - `Unsupported`: Embree cannot be loaded, or this build does not have it.
    /// - `Retry`: there is too little memory.
    /// - `Interrupted`: the monitor was stopped.
    pub fn with_backend(
        meshes: Vec<Box<dyn MeshArrays>>,
        backend: RayBackend,
        monitor: &Monitor,
    ) -> Result<Self> {
        let mut range = Box3::EMPTY;
        for (index, mesh) in meshes.iter().enumerate() {
            let place = if meshes.len() > 1 { format!("mesh {index}: ") } else { String::new() };
            range = range.union(arrays::check(mesh.as_ref(), &place)?);
        }
        if meshes.is_empty() {
            return Err(Error::invalid("meshes", "found no mesh, expected at least one"));
        }
        let origin = origin_of(range);
        let rounded = meshes.iter().map(|mesh| rounded(mesh.as_ref(), origin));
        let geometry = Geometry::new(origin, rounded.collect::<Result<_>>()?, vec![], vec![]);
        let geometry = geometry.map_err(|count| {
            let message = format!("found {count} faces, expected at most 4294967294");
            Error::new(ErrorKind::Limit, Problem::new("faces", message))
        })?;
        monitor.begin(Phase::Build, 1000);
        let threads = rayon::current_num_threads();
        let of_pictures = match backend {
            RayBackend::Bvh => Backend::default(),
            RayBackend::Embree => Backend::Embree(EmbreeMode::Robust),
        };
        memory::ensure_build_may_fit(of_pictures, threads, geometry.accelerated())?;
        let tree = match backend {
            RayBackend::Bvh => {
                SceneTree::Bvh(Box::new(OwnedBvh::build(geometry, Isa::detect(), monitor)?))
            }
            RayBackend::Embree => {
                let geometry = Arc::new(geometry);
                let options = BuildOptions { threads, max_bytes: None };
                let built =
                    accel::build_shared(Arc::clone(&geometry), of_pictures, &options, monitor)?;
                SceneTree::Embree { accelerator: built.into(), geometry }
            }
        };
        monitor.set_done(1000);
        let (closed, multipoles, open_multipoles) =
            (OnceLock::new(), OnceLock::new(), OnceLock::new());
        let bounds = [range.min, range.max];
        Ok(Self { meshes, tree, bounds, closed, multipoles, open_multipoles })
    }

    /// The meshes, in order.
    pub fn meshes(&self) -> &[Box<dyn MeshArrays>] {
        &self.meshes
    }

    /// Lower and upper corner of the box around all faces.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        self.bounds.map(|corner| corner.to_array())
    }

    /// Bytes of the tree, which the scene holds beside the arrays of the meshes. What queries about
    /// points keep is not counted: multipoles, and which meshes are closed.
    pub fn bytes(&self) -> u64 {
        self.info().bytes
    }

    /// Most bytes that the build held beside the arrays of the meshes.
    pub fn peak_bytes(&self) -> u64 {
        self.info().peak_bytes
    }

    fn info(&self) -> BuildInfo {
        match &self.tree {
            SceneTree::Bvh(tree) => tree.info(),
            SceneTree::Embree { accelerator, geometry } => {
                let BuildInfo { version, isa, bytes, peak_bytes } = accelerator.info();
                // Embree reads the vertices and indices of the geometry.
                let rounded = geometry.bytes();
                let (bytes, peak_bytes) = (bytes + rounded, peak_bytes + rounded);
                BuildInfo { version, isa, bytes, peak_bytes }
            }
        }
    }

    /// The tree for closest hits and occlusion.
    pub(super) fn accelerator(&self) -> Arc<dyn Accelerator + '_> {
        match &self.tree {
            SceneTree::Bvh(tree) => Arc::new(tree.bvh()),
            SceneTree::Embree { accelerator, .. } => Arc::clone(accelerator) as _,
        }
    }

    /// The tree for all other queries.
    ///
    /// # Errors
    /// `Unsupported` if the backend is Embree.
    pub(super) fn bvh(&self) -> Result<Bvh<'_>> {
        match &self.tree {
            SceneTree::Bvh(tree) => Ok(tree.bvh()),
            SceneTree::Embree { .. } => {
                let message = "found `embree`, which answers only `closest` and `occluded`";
                let problem = Problem::new("backend", message);
                let help = "`bvh`, the default, answers all queries";
                Err(Error::new(ErrorKind::Unsupported, problem.help(help)))
            }
        }
    }

    /// Maps scene-wide primitive indices to meshes, and holds the origin of the coordinates.
    pub(super) fn geometry(&self) -> &Geometry {
        match &self.tree {
            SceneTree::Bvh(tree) => tree.geometry(),
            SceneTree::Embree { geometry, .. } => geometry,
        }
    }

    /// Position that the coordinates of the tree are relative to.
    pub(super) fn origin(&self) -> DVec3 {
        self.geometry().origin
    }

    /// Lower and upper corner of the box of all triangles, relative to the origin and rounded.
    pub(super) fn local_bounds(&self) -> [[f32; 3]; 2] {
        self.bounds.map(|corner| (corner - self.origin()).as_vec3().to_array())
    }

    /// Mesh and face of a triangle, by its scene-wide index.
    pub(super) fn place(&self, primitive: u32) -> (usize, usize) {
        let (mesh, face) = self.geometry().place(primitive);
        (mesh as usize, face as usize)
    }

    /// Corners of a triangle, by its scene-wide index. NaN if the caller's arrays have changed so
    /// that an index is out of range.
    pub(super) fn corners(&self, primitive: u32) -> [DVec3; 3] {
        let (mesh, face) = self.place(primitive);
        arrays::corners(self.meshes[mesh].as_ref(), face)
    }

    /// Bound of how far rounding to f32 moves a vertex of the tree or a point, which must be within
    /// `reach` of the origin.
    pub(super) fn slack(&self, reach: f64) -> f32 {
        let [low, high] = self.local_bounds();
        let far = low.into_iter().chain(high).fold(reach as f32, |far, x| far.max(x.abs()));
        far * (2.0 * f32::EPSILON) + f32::MIN_POSITIVE
    }
}

/// The position that coordinates are rounded relative to: 0 if their box is near 0, so that f32
/// vertices keep their bits. Else the middle of the box, rounded to f32.
fn origin_of(range: Box3) -> DVec3 {
    let (middle, size) = (range.center(), (range.max - range.min).max_element());
    if middle.abs().max_element() <= size { DVec3::ZERO } else { middle.as_vec3().as_dvec3() }
}

/// Rounds a mesh to f32, relative to `origin`.
fn rounded(mesh: &dyn MeshArrays, origin: DVec3) -> Result<TriangleMesh> {
    let (vertices, faces) = (mesh.vertices(), mesh.faces());
    // A mesh has one element of padding.
    let mut local = reserve::filled([0f32; 3], vertices.len() + 1, "vertices")?;
    local.pop();
    parallel::fill(&mut local, |i| {
        let vertex = vertices.get(i).filter(|v| v.is_finite()).unwrap_or(origin);
        (vertex - origin).as_vec3().to_array()
    });
    let mut triangles = reserve::filled([0; 3], faces.len(), "faces")?;
    let count = vertices.len() as u64;
    let last = (vertices.len() - 1) as u32;
    // The caller's arrays may have changed since they were checked.
    let triangle = |i: usize| faces.get(i).map(|v| v.map_or(last, |v| v.min(count - 1) as u32));
    parallel::fill(&mut triangles, triangle);
    Ok(TriangleMesh::new(local, triangles, false))
}
