//! A tree that does not borrow the arrays it was built from.

use std::sync::Arc;

use super::build::Tree;
use super::tree::Bvh;
use crate::accel::accelerator::{Accelerator, BuildInfo, BuildOptions};
use crate::error::Result;
use crate::geometry::{Geometry, TriangleMesh};
use crate::monitor::Monitor;
use crate::simd::Isa;

/// A tree over triangle meshes, with the primitive indices of the meshes. The leaves hold the
/// vertices, so the arrays of the meshes are freed after the build.
pub struct OwnedBvh {
    /// Maps scene-wide primitive indices to meshes. Its meshes are empty.
    geometry: Geometry,
    tree: Arc<Tree>,
    isa: Isa,
    peak_bytes: u64,
}

impl OwnedBvh {
    /// Builds the tree over the triangles of `geometry`, on the current rayon pool.
    ///
    /// # Errors
    /// `Interrupted` after a signal; `Limit` from 2^30 triangles on; `Retry` if there is too little
    /// memory.
    pub fn build(mut geometry: Geometry, isa: Isa, monitor: &Monitor) -> Result<Self> {
        let options = BuildOptions { threads: rayon::current_num_threads(), max_bytes: None };
        let Bvh { tree, isa, peak_bytes, .. } = Bvh::build(&geometry, isa, &options, monitor)?;
        let peak_bytes = peak_bytes + geometry.bytes();
        geometry.meshes.iter_mut().for_each(|mesh| *mesh = TriangleMesh::default());
        Ok(Self { geometry, tree, isa, peak_bytes })
    }

    /// Returns the tree as an accelerator.
    pub fn bvh(&self) -> Bvh<'_> {
        let Self { geometry, tree, isa, peak_bytes } = self;
        let geometry = geometry.into();
        Bvh { geometry, tree: Arc::clone(tree), isa: *isa, peak_bytes: *peak_bytes }
    }

    /// Maps scene-wide primitive indices to meshes, and holds the origin of the coordinates. Its
    /// meshes are empty.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Version, instruction set and memory.
    pub fn info(&self) -> BuildInfo {
        self.bvh().info()
    }
}
