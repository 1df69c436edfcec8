//! Options for reading the scene's files.

use std::path::PathBuf;

use crate::error::Result;
use crate::mesh::{self, Mesh};
use crate::monitor::Monitor;
use crate::reserve::MemoryLimit;
use crate::scene::{CheckedCamera, Trimesh};

use super::color_request;

/// Options for reading the scene's files.
#[derive(Debug, Default)]
pub struct LoadOptions {
    /// Drop triangles that use bad vertices instead of refusing the mesh.
    pub repair: bool,
    /// Read meshes through a window instead of mapping their files into memory.
    pub no_mmap: bool,
    /// Meshes that are in memory already, by the path that the scene uses for them.
    pub ready: Vec<(PathBuf, Mesh)>,
    /// Memory limit of the arrays of all meshes.
    pub memory_limit: Option<MemoryLimit>,
    /// Memory limit in bytes of all textures, decoding included. `None`: the limit is
    /// `memory_limit`. A texture of a surface never takes more than 4 GiB. The image of an
    /// environment takes more only if one of the limits is set.
    pub texture_bytes: Option<u64>,
    /// Make a copy of the mesh for each instance, for backends that trace no instances. Copies are
    /// also made if the scene's own backend needs them.
    pub copy_instances: bool,
    /// Most texels of an image that is held in memory whole. `None`: 8192 x 8192. Larger images of
    /// surfaces, of 8 bits a channel, are in temporary files.
    pub whole_texels: Option<u64>,
    /// Measures the [`Resolution`](super::Resolution) of every mesh. Without it, collapsed edges
    /// are searched only in meshes where they are likely.
    pub resolutions: bool,
    /// All cameras of the render, for warnings. The caller then warns about rounding. Empty: the
    /// scene's camera alone.
    pub cameras: Vec<CheckedCamera>,
}

impl LoadOptions {
    /// Reads a mesh, or takes it if it is in memory already.
    pub(super) fn mesh(
        &mut self,
        spec: &Trimesh,
        textured: bool,
        monitor: &Monitor,
    ) -> Result<Mesh> {
        let path = spec.path.as_path();
        let ready = self.ready.iter().position(|(ready, _)| ready == path);
        // A limit that the user set includes meshes in memory. One that was measured as free memory
        // does not: they were in memory already.
        let counts = ready.is_none() || self.memory_limit.is_some_and(|limit| limit.set_by_user);
        let mesh = match ready {
            Some(index) => self.ready.swap_remove(index).1,
            None => {
                let options = mesh::ReadOptions::default()
                    .repair(self.repair)
                    .memory_limit(self.memory_limit);
                let options = options.color(color_request(spec, textured));
                let options = options.points(spec.points.is_some());
                let options = options.textures(!textured && spec.color.is_none());
                mesh::read_ply(path, options.mmap(!self.no_mmap).monitor(monitor))?
            }
        };
        let left = |limit: MemoryLimit| if counts { limit.less(mesh.bytes()) } else { limit };
        self.memory_limit = self.memory_limit.map(left);
        Ok(mesh)
    }
}
