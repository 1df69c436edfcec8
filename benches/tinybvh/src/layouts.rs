//! tinybvh's layouts as accelerators of lightpath, through the functions of `shim.cpp`.

use std::ffi::{c_int, c_void};

use lightpath::accel::{Accelerator, BuildInfo};
use lightpath::geometry::Geometry;
use lightpath::ray::{Coherence, Hits, Mask, RayPacket, Rays};

/// A layout of tinybvh with its builder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// `BVH8_CPU` with the default builder.
    Wide8 = 0,
    /// `BVH8_CPU` with spatial splits (`BuildHQ`).
    Wide8Splits = 1,
    /// `BVH4_CPU` with the default builder.
    Wide4 = 2,
    /// `BVH_Double`, in double precision.
    Double = 3,
}

impl Layout {
    /// All layouts that are measured.
    pub const ALL: [Self; 4] = [Self::Wide8, Self::Wide8Splits, Self::Wide4, Self::Double];

    /// Returns the name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Wide8 => "BVH8_CPU",
            Self::Wide8Splits => "BVH8_CPU, BuildHQ",
            Self::Wide4 => "BVH4_CPU",
            Self::Double => "BVH_Double",
        }
    }
}

/// The triangles of a scene in tinybvh's format.
pub struct Corners {
    /// Three corners per triangle: x, y, z and an unused float.
    corners: Vec<[f32; 4]>,
    /// Number of triangles of the mesh, which precede the halves of the quads.
    mesh: u32,
}

impl Corners {
    /// Collects the triangles of the single mesh, then two per quad.
    pub fn of(geometry: &Geometry) -> Self {
        let [mesh] = &geometry.meshes[..] else { panic!("expected a scene of one mesh") };
        assert!(geometry.spheres.is_empty(), "expected a scene without spheres");
        let count = mesh.triangles().len() as u32;
        let triangles = (0..count).map(|prim| mesh.corners(prim));
        let halves = geometry.quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
        let corners = triangles.chain(halves).flatten().map(|[x, y, z]| [x, y, z, 0.0]);
        Self { corners: corners.collect(), mesh: count }
    }

    /// Returns the number of triangles.
    pub fn triangles(&self) -> u32 {
        (self.corners.len() / 3) as u32
    }
}

/// Memory of a tree in bytes.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub struct Cost {
    /// Growth of the heap.
    pub held: u64,
    /// Bytes that queries read: nodes, triangles, indices, vertices.
    pub read: u64,
}

// shim.cpp declares the same structures. A change of their size must change both.
const _: () = assert!(size_of::<Rays>() == 12 * 64 && size_of::<Hits>() == 9 * 64);

unsafe extern "C" {
    fn shim_build(
        layout: c_int,
        corners: *const f32,
        triangles: u32,
        cost: *mut Cost,
    ) -> *mut c_void;
    fn shim_release(tree: *mut c_void);
    fn shim_closest(
        tree: *const c_void,
        active: *const Mask,
        rays: *mut Rays,
        hits: *mut Hits,
        offset: f32,
        quads: u32,
    );
    fn shim_occluded(tree: *const c_void, active: *const Mask, rays: *mut Rays, offset: f32);
}

/// A tree of tinybvh.
pub struct TinyBvh<'c> {
    tree: *mut c_void,
    corners: &'c Corners,
    offset: f32,
    /// Memory of the tree.
    pub cost: Cost,
}

// SAFETY: a built tree is immutable, and the queries of tinybvh keep their state on the stack.
unsafe impl Send for TinyBvh<'_> {}
// SAFETY: as above.
unsafe impl Sync for TinyBvh<'_> {}

impl<'c> TinyBvh<'c> {
    /// Builds a tree, on all threads of the machine if tinybvh's builder is parallel. Rays that
    /// leave a surface start `offset` further along.
    pub fn build(corners: &'c Corners, layout: Layout, offset: f32) -> Self {
        let mut cost = Cost::default();
        // SAFETY: the corners are three per triangle and outlive the tree ('c).
        let tree = unsafe {
            let first = corners.corners.as_ptr().cast();
            shim_build(layout as c_int, first, corners.triangles(), &raw mut cost)
        };
        Self { tree, corners, offset, cost }
    }
}

impl Drop for TinyBvh<'_> {
    fn drop(&mut self) {
        // SAFETY: built by `shim_build`, released once.
        unsafe { shim_release(self.tree) };
    }
}

impl Accelerator for TinyBvh<'_> {
    fn info(&self) -> BuildInfo {
        let version = format!("tinybvh {}", env!("TINYBVH_VERSION"));
        BuildInfo { version, isa: "AVX2".into(), bytes: self.cost.held, peak_bytes: 0 }
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, _: Coherence) {
        let RayPacket { rays, hits } = packet;
        // SAFETY: a live tree, and structures of the layout that the shim declares.
        unsafe { shim_closest(self.tree, active, rays, hits, self.offset, self.corners.mesh) };
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        // SAFETY: as above.
        unsafe { shim_occluded(self.tree, active, rays, self.offset) };
    }
}
