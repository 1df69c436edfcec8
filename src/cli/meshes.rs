//! What the program asks about mesh files: the one place that knows the PLY reader.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::{
    error::Result,
    mesh::{self, Mesh, Positions},
    scene::Trimesh,
};

/// Reads a file.
pub fn read(path: &Path, repair: bool) -> Result<Mesh> {
    mesh::read_ply(path, mesh::ReadOptions::default().repair(repair))
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

/// Reads the header alone.
pub fn promise(path: &Path) -> Result<Promise> {
    let summary = mesh::inspect_ply(path)?;
    // The reader refuses a header that promises more rows than the file has bytes; a prediction
    // must not choke on it first.
    let lies = summary.triangles.max(summary.vertices) > summary.file_bytes;
    Ok(match lies {
        true => Promise::default(),
        false => Promise {
            array_bytes: summary.array_bytes,
            missing_normal_bytes: if summary.normals { 0 } else { 12 * summary.vertices },
            triangles: summary.triangles,
        },
    })
}

/// Whether a file name is a mesh's.
pub fn is_mesh(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    [".ply", ".ply.gz", ".ply.zst"].iter().any(|end| name.ends_with(end))
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
        let count = match &mesh.positions {
            Positions::F32(p) => p.len(),
            Positions::F64(p) => p.len(),
        };
        let mut used = vec![false; count];
        for triangle in &mesh.triangles {
            for corner in triangle {
                used[*corner as usize] = true;
            }
        }
        Self { mesh, used }
    }

    /// All of them, again and again.
    pub fn iter(&self) -> impl Iterator<Item = DVec3> + '_ {
        let at = |i: usize| match &self.mesh.positions {
            Positions::F32(p) => p[i].map(f64::from).into(),
            Positions::F64(p) => p[i].into(),
        };
        let used = self.used.iter().enumerate().filter(|(_, used)| **used);
        used.map(move |(i, _)| at(i))
    }

    /// Lowest and highest corner of their box; `None` if there is none.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        bounds(self.iter())
    }
}

/// Lowest and highest corner of the box around points.
pub fn bounds(points: impl Iterator<Item = DVec3>) -> Option<[DVec3; 2]> {
    points.fold(None, |ends, p| match ends {
        None => Some([p, p]),
        Some([low, high]) => Some([low.min(p), high.max(p)]),
    })
}

/// File units -> world units as docs/scene-format.md says, without the final `center`.
pub fn placement(spec: &Trimesh, [low, high]: [DVec3; 2]) -> (DMat3, DVec3) {
    let turn = spec.rotate_deg;
    let rotation = DMat3::from_rotation_z(turn.z.to_radians())
        * DMat3::from_rotation_y(turn.y.to_radians())
        * DMat3::from_rotation_x(turn.x.to_radians());
    match spec.fit {
        Some(fit) => {
            let scale = fit / (high - low).max_element();
            (rotation * (scale * spec.size), (low + high) / 2.0)
        }
        None => (rotation * spec.size, DVec3::ZERO),
    }
}
