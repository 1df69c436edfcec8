//! Reads mesh files for the studio, and iterates over the vertices that are used.

use std::collections::HashSet;
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::mesh::{self, Mesh, ReadOptions};
use crate::monitor::Monitor;
use crate::scene::begins_as_ply;
use crate::world::Bounds;

use super::subject::Subject;

/// Reads the mesh file of a subject: the data that `options` select, with the subject's options for
/// reading.
pub fn read(subject: &Subject, options: ReadOptions, monitor: &Monitor) -> Result<Mesh> {
    let options = options.repair(subject.repair).mmap(!subject.no_mmap);
    mesh::read_ply(subject.path, options.memory_limit(subject.memory_limit).monitor(monitor))
}

/// Returns true if a file is a PLY mesh, by its name or its first bytes.
pub fn is_mesh(path: &Path) -> bool {
    is_named_mesh(path) || begins_as_ply(path)
}

/// Returns true if a path has the ending of a mesh.
pub fn is_named_mesh(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    [".ply", ".ply.gz", ".ply.zst"].iter().any(|end| name.ends_with(end))
}

/// The vertices that triangles use, or all of a cloud of points, in file units.
#[derive(Debug)]
pub struct UsedVertices<'m> {
    mesh: &'m Mesh,
    used: Vec<bool>,
}

impl<'m> UsedVertices<'m> {
    /// Finds the vertices that triangles use.
    pub fn new(mesh: &'m Mesh) -> Self {
        Self { mesh, used: mesh.used_vertices() }
    }

    /// Returns the number of vertices that no triangle and no stitch uses.
    pub fn unused(&self) -> u64 {
        let stitches = self.mesh.stitches.iter().flatten().copied();
        let only_there: HashSet<u32> = stitches.filter(|&v| !self.used[v as usize]).collect();
        (self.used.iter().filter(|used| !**used).count() - only_there.len()) as u64
    }

    /// Returns an iterator over the used vertices.
    pub fn par_iter(&self) -> impl ParallelIterator<Item = DVec3> + '_ {
        let all = self.used.par_iter().with_min_len(1 << 14).enumerate();
        all.filter(|(_, used)| **used).map(|(i, _)| self.mesh.positions.get(i))
    }

    /// Returns the bounding box of the used vertices after `place` is applied to them; empty if
    /// there are none.
    pub fn bounds(&self, place: impl Fn(DVec3) -> DVec3 + Sync) -> Bounds {
        let point = |i: usize| self.used[i].then(|| place(self.mesh.positions.get(i)));
        Bounds::from_points(self.used.len(), point)
    }
}
