//! What the program asks about mesh files: the one place that knows the PLY reader.

use std::path::Path;

use glam::DVec3;

use crate::{
    error::Result,
    mesh::{self, Mesh},
    scene::begins_as_ply,
    world::Bounds,
};

/// Reads a file; `no_mmap`: without mapping it into memory.
pub fn read(path: &Path, repair: bool, no_mmap: bool) -> Result<Mesh> {
    mesh::read_ply(path, mesh::ReadOptions::default().repair(repair).mmap(!no_mmap))
}

/// What a header promises, within what the file's size allows.
#[derive(Debug, Clone, Copy, Default)]
pub struct Promise {
    /// Bytes of vertex and index arrays.
    pub array_bytes: u64,
    /// Bytes of the vertex normals that the file does not have.
    pub missing_normal_bytes: u64,
    /// Triangles after splitting.
    pub triangles: u64,
}

/// Bytes that one byte of gzip data can stand for; more for zstd, but not of a mesh.
const MOST_PACKED: u64 = 1032;

/// Reads the header alone.
pub fn promise(path: &Path) -> Result<Promise> {
    let summary = mesh::inspect_ply(path)?;
    // The reader refuses a header that promises more rows than the file has bytes; a prediction
    // must not choke on it first.
    let most = match summary.packed {
        None => summary.file_bytes,
        Some(_) => summary.file_bytes.saturating_mul(MOST_PACKED),
    };
    let lies = summary.triangles.max(summary.vertices) > most;
    Ok(match lies {
        true => Promise::default(),
        false => Promise {
            array_bytes: summary.array_bytes,
            missing_normal_bytes: if summary.normals { 0 } else { 12 * summary.vertices },
            triangles: summary.triangles,
        },
    })
}

/// Whether a file is a mesh, by its name or its first bytes.
pub fn is_mesh(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    [".ply", ".ply.gz", ".ply.zst"].iter().any(|end| name.ends_with(end)) || begins_as_ply(path)
}

/// The vertices that triangles use, in file units.
#[derive(Debug)]
pub struct Points<'m> {
    mesh: &'m Mesh,
    used: Vec<bool>,
}

impl<'m> Points<'m> {
    /// Finds the used ones.
    pub fn of(mesh: &'m Mesh) -> Self {
        Self { mesh, used: mesh.used_vertices() }
    }

    /// How many vertices there are beside them.
    pub fn unused(&self) -> u64 {
        self.used.iter().filter(|used| !**used).count() as u64
    }

    /// All of them, again and again.
    pub fn iter(&self) -> impl Iterator<Item = DVec3> + '_ {
        let used = self.used.iter().enumerate().filter(|(_, used)| **used);
        used.map(|(i, _)| self.mesh.positions.get(i))
    }

    /// The box of what `place` makes of them; empty if there are none.
    pub fn bounds(&self, place: impl Fn(DVec3) -> DVec3 + Sync) -> Bounds {
        let point = |i: usize| self.used[i].then(|| place(self.mesh.positions.get(i)));
        Bounds::of_points(self.used.len(), point)
    }
}
