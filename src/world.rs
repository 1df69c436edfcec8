//! [`Scene`] -> [`World`]: meshes and textures loaded, everything relative to one f64 origin.

use crate::{
    error::{Error, Problem, Result},
    geometry::Geometry,
    monitor::Monitor,
    scene::Scene,
};

/// How files are read.
#[derive(Debug, Clone, Copy, Default)]
pub struct LoadOptions {
    /// Drop triangles that use bad vertices instead of refusing the mesh.
    pub repair: bool,
}

/// Everything a render needs except the accelerator.
#[derive(Debug)]
pub struct World {
    /// What the accelerator is built over.
    pub geometry: Geometry,
}

impl World {
    /// Opens the scene's files and prepares what rays need. Problems that do not stop a render
    /// are returned as warnings.
    pub fn load(
        _scene: &Scene,
        _options: LoadOptions,
        _monitor: &Monitor,
    ) -> Result<(Self, Vec<Problem>)> {
        Err(Error::invalid("", "to be written"))
    }

    /// Triangles of all meshes.
    pub fn triangles(&self) -> u64 {
        0
    }

    /// Bytes held by mesh arrays and textures.
    pub fn mesh_bytes(&self) -> u64 {
        0
    }
}
