//! A mesh as its file has it: arrays in file units, indices checked, nothing transformed.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::files::Stamp;

/// Vertex positions in the precision of the file.
#[derive(Debug, Clone)]
pub enum Positions {
    /// `float` (or narrower) coordinates.
    F32(Vec<[f32; 3]>),
    /// `double` (or 32-bit integer) coordinates.
    F64(Vec<[f64; 3]>),
}

impl Positions {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(p) => p.len(),
            Self::F64(p) => p.len(),
        }
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Vertex `i`, exactly.
    #[inline]
    pub fn get(&self, i: usize) -> DVec3 {
        match self {
            Self::F32(p) => DVec3::from(p[i].map(f64::from)),
            Self::F64(p) => DVec3::from(p[i]),
        }
    }
}

/// Texture coordinates with v up, as files have them.
#[derive(Debug, Clone)]
pub enum Uvs {
    /// One per vertex.
    PerVertex(Vec<[f32; 2]>),
    /// Three per triangle, in the order of its corners.
    PerCorner(Vec<[[f32; 2]; 3]>),
}

/// Vertex colours as stored; integers are fractions of their type's maximum, sRGB-encoded unless
/// the scene says otherwise, floats are linear.
#[derive(Debug, Clone)]
pub enum Colors {
    /// 8-bit.
    U8(Vec<[u8; 3]>),
    /// 16-bit.
    U16(Vec<[u16; 3]>),
    /// Float.
    F32(Vec<[f32; 3]>),
}

/// A triangle mesh in file units.
///
/// Every index is below the number of vertices; every vertex that a triangle uses is finite; no
/// triangle repeats a vertex index.
#[derive(Debug, Clone)]
pub struct Mesh {
    /// All vertices of the file, used or not.
    pub positions: Positions,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles without area between three different points, in the order of the file. Where they close
    /// T-junctions they are kept in a scene.
    pub stitches: Vec<[u32; 3]>,
    /// Per-vertex normals, as stored (any length).
    pub normals: Option<Vec<[f32; 3]>>,
    /// Texture coordinates.
    pub uvs: Option<Uvs>,
    /// Vertex colours.
    pub colors: Option<Colors>,
    /// `comment TextureFile NAME`: of several the one that most triangles want by `texnumber`, or
    /// the first.
    pub texture_file: Option<String>,
    /// What was used, ignored, split and dropped on the way in.
    pub notes: Notes,
}

impl Mesh {
    /// A mesh from memory, without normals, texture coordinates and colours: fill these in afterwards.
    ///
    /// # Errors
    /// `Invalid` for an index beyond the vertices, a vertex that is not finite, a triangle that has a
    /// vertex twice, and where there is no triangle or there are more than 2^32 - 2 vertices.
    pub fn new(positions: Positions, triangles: Vec<[u32; 3]>) -> Result<Self> {
        let count = positions.len();
        let refused = |message: String| Err(Error::invalid("mesh", message));
        if triangles.is_empty() || count >= u32::MAX as usize {
            return refused(format!("found {} triangles, {count} vertices", triangles.len()));
        }
        for (index, triangle) in triangles.iter().enumerate() {
            if let Some(vertex) = triangle.iter().find(|&&vertex| vertex as usize >= count) {
                return refused(format!(
                    "found vertex {vertex} in triangle {index}, expected less than {count}"
                ));
            }
            let [a, b, c] = *triangle;
            if a == b || b == c || c == a {
                return refused(format!("found a vertex twice in triangle {index}"));
            }
            if let Some(v) = triangle.iter().find(|&&v| !positions.get(v as usize).is_finite()) {
                return refused(format!("found vertex {v}, which is not finite"));
            }
        }
        Ok(Self {
            positions,
            triangles,
            stitches: Vec::new(),
            normals: None,
            uvs: None,
            colors: None,
            texture_file: None,
            notes: Notes::default(),
        })
    }

    /// Bytes of all arrays.
    pub fn bytes(&self) -> u64 {
        let positions = match &self.positions {
            Positions::F32(all) => size_of_val(&all[..]),
            Positions::F64(all) => size_of_val(&all[..]),
        };
        let uvs = self.uvs.as_ref().map_or(0, |uvs| match uvs {
            Uvs::PerVertex(all) => size_of_val(&all[..]),
            Uvs::PerCorner(all) => size_of_val(&all[..]),
        });
        let colors = self.colors.as_ref().map_or(0, |colors| match colors {
            Colors::U8(all) => size_of_val(&all[..]),
            Colors::U16(all) => size_of_val(&all[..]),
            Colors::F32(all) => size_of_val(&all[..]),
        });
        let normals = self.normals.as_ref().map_or(0, |all| size_of_val(&all[..]));
        (positions + size_of_val(&self.triangles[..]) + normals + uvs + colors) as u64
    }

    /// Which vertices triangles use.
    pub fn used_vertices(&self) -> Vec<bool> {
        let count = self.positions.len();
        let used: Vec<AtomicBool> =
            (0..count).into_par_iter().with_min_len(1 << 16).map(|_| false.into()).collect();
        self.triangles.par_iter().with_min_len(1 << 14).for_each(|triangle| {
            for &vertex in triangle {
                used[vertex as usize].store(true, Relaxed);
            }
        });
        used.into_iter().map(AtomicBool::into_inner).collect()
    }
}

/// What reading a mesh file did beyond copying.
#[derive(Debug, Clone, Default)]
pub struct Notes {
    /// `ascii`, `binary_little_endian`, `binary_big_endian`.
    pub format: &'static str,
    /// Faces in the file, before triangulation.
    pub faces: u64,
    /// Faces with more than three corners that were split.
    pub polygons_split: u64,
    /// Faces with fewer than three corners, skipped.
    pub faces_too_small: u64,
    /// Triangles that repeat a vertex or have zero area: dropped, but for the [`Mesh::stitches`] that close a
    /// How many files `comment TextureFile` names; one is shown.
    pub texture_files: usize,
    /// T-junction.
    pub degenerate_dropped: u64,
    /// Triangles over the same three vertices as an earlier one, in whatever order, dropped.
    pub duplicates_dropped: u64,
    /// Triangles dropped by `--repair` because they use a missing or non-finite vertex.
    pub repaired_dropped: u64,
    /// Different values of `texnumber`: textures that the faces want.
    pub textures: u64,
    /// Bytes after the last row: the header may declare too few.
    pub trailing_bytes: u64,
    /// The file as it was when it was opened; none for a pipe.
    pub stamp: Option<Stamp>,
    /// `element.property` names that were used, in file order.
    pub used: Vec<String>,
    /// `element.property` names that were read over.
    pub ignored: Vec<String>,
}
