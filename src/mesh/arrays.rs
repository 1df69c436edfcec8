//! A triangle mesh as its file stores it: arrays in file units, indices checked, no transform.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

use glam::DVec3;

use crate::files::Stamp;
use crate::parallel;

/// Vertex positions in the precision of the file.
#[derive(Debug, Clone)]
pub enum Positions {
    /// Coordinates in single precision: all are `float` or narrower.
    F32(Vec<[f32; 3]>),
    /// Coordinates in double precision: at least one is `double`, `int` or `uint`.
    F64(Vec<[f64; 3]>),
}

impl Positions {
    /// Returns the number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(p) => p.len(),
            Self::F64(p) => p.len(),
        }
    }

    /// Returns true if there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the position of vertex `i`. The conversion to `f64` is exact.
    #[doc(hidden)]
    #[inline]
    pub fn get(&self, i: usize) -> DVec3 {
        match self {
            Self::F32(p) => DVec3::from(p[i].map(f64::from)),
            Self::F64(p) => DVec3::from(p[i]),
        }
    }
}

/// Texture coordinates. v points up, as in PLY files.
#[derive(Debug, Clone)]
pub enum Uvs {
    /// One coordinate pair per vertex.
    PerVertex(Vec<[f32; 2]>),
    /// Three coordinate pairs per triangle, in the order of its corners.
    PerCorner(Vec<[[f32; 2]; 3]>),
}

/// Colours as stored. Integers are fractions of their type's maximum. They are sRGB-encoded, unless
/// the scene specifies another encoding. Floats are linear.
#[derive(Debug, Clone)]
pub enum Colors {
    /// 8-bit integers, 255 = 1.
    U8(Vec<[u8; 3]>),
    /// 16-bit integers, 65535 = 1.
    U16(Vec<[u16; 3]>),
    /// 32-bit floats, with linear values.
    F32(Vec<[f32; 3]>),
}

impl Colors {
    /// Returns the size of the array in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::U8(all) => size_of_val(&all[..]),
            Self::U16(all) => size_of_val(&all[..]),
            Self::F32(all) => size_of_val(&all[..]),
        }
    }
}

/// One number per vertex or triangle, in a type that holds every value of the file's type.
#[derive(Debug, Clone)]
pub enum Scalars {
    /// `uchar`.
    U8(Vec<u8>),
    /// `ushort`.
    U16(Vec<u16>),
    /// `float`, `char` and `short`.
    F32(Vec<f32>),
    /// `double`, `int` and `uint`.
    F64(Vec<f64>),
}

impl Scalars {
    /// Returns the number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(all) => all.len(),
            Self::U16(all) => all.len(),
            Self::F32(all) => all.len(),
            Self::F64(all) => all.len(),
        }
    }

    /// Returns true if there is no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns value `i`. The conversion to `f64` is exact.
    ///
    /// # Panics
    /// If there is no such value.
    #[inline]
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Self::U8(all) => all[i].into(),
            Self::U16(all) => all[i].into(),
            Self::F32(all) => all[i].into(),
            Self::F64(all) => all[i],
        }
    }

    /// Returns the size of the array in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::U8(all) => size_of_val(&all[..]),
            Self::U16(all) => size_of_val(&all[..]),
            Self::F32(all) => size_of_val(&all[..]),
            Self::F64(all) => size_of_val(&all[..]),
        }
    }
}

/// The element of a file that colours or a property belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshElement {
    /// The vertices of the file.
    Vertex,
    /// The faces of the file. The arrays have one value per triangle.
    Face,
}

impl MeshElement {
    /// Returns the name of the element in a PLY file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vertex => "vertex",
            Self::Face => "face",
        }
    }
}

/// The values of a scalar property of the file.
#[derive(Debug, Clone)]
pub struct Property {
    /// Name of the property, such as `quality`.
    pub name: String,
    /// Whether vertices or faces have the property.
    pub element: MeshElement,
    /// One value per vertex or per triangle.
    pub values: Scalars,
}

/// Textures of the triangles, if a file names several.
#[derive(Debug, Clone)]
pub struct FaceTextures {
    /// Names of the image files. `texnumber` is an index into them.
    pub files: Vec<String>,
    /// For each triangle, an index into `files`, or [`FaceTextures::NO_TEXTURE`].
    pub indices: Vec<u16>,
}

impl FaceTextures {
    /// Index of a triangle without a texture: `texnumber` is -1, or out of range and repaired.
    pub const NO_TEXTURE: u16 = u16::MAX;
}

/// A triangle mesh in file units.
///
/// Every index is below the number of vertices. Every vertex that a triangle uses is finite. No
/// triangle repeats a vertex index.
#[derive(Debug, Clone)]
pub struct Mesh {
    /// All vertices of the file, used or not.
    pub positions: Positions,
    /// Three vertex indices per triangle. Empty if the file was read as points.
    pub triangles: Vec<[u32; 3]>,
    /// Stitches: triangles with zero area that close T-junctions, in file order. Their three
    /// corners are different points. A [`RayScene`](crate::RayScene) counts them after the
    /// triangles; a [`Renderer`](crate::Renderer) answers with a triangle beside them.
    pub stitches: Vec<[u32; 3]>,
    /// Vertex normals as stored, of any length.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Texture coordinates, if the file has any.
    pub uvs: Option<Uvs>,
    /// Colours of the vertices, if the file has any and they were requested.
    pub colors: Option<Colors>,
    /// Colours of the faces, one per triangle, if the file has any and they were requested. By
    /// default they are read only if the vertices have no colours.
    pub face_colors: Option<Colors>,
    /// Alpha of `colors`, else of `face_colors`. `None` if the file has no alpha, if all values are
    /// opaque, or if all are 0. Integers are fractions of their type's maximum.
    pub alpha: Option<Scalars>,
    /// The scalar property that was requested.
    pub property: Option<Property>,
    /// The file name in `comment TextureFile NAME`. If there are several, this is the one that most
    /// triangles select by `texnumber`, or else the first. `None` also if all triangles have the
    /// same `texnumber` and no name has this index.
    pub texture_file: Option<String>,
    /// Textures of the triangles, if they have different ones and these were requested.
    pub textures: Option<FaceTextures>,
    /// What the reader used, skipped, split and dropped.
    #[doc(hidden)]
    pub notes: Notes,
}

impl Mesh {
    /// Returns the size in bytes of all arrays, `stitches` not included.
    pub fn bytes(&self) -> u64 {
        let positions = match &self.positions {
            Positions::F32(all) => size_of_val(&all[..]),
            Positions::F64(all) => size_of_val(&all[..]),
        };
        let uvs = self.uvs.as_ref().map_or(0, |uvs| match uvs {
            Uvs::PerVertex(all) => size_of_val(&all[..]),
            Uvs::PerCorner(all) => size_of_val(&all[..]),
        });
        let colors = [&self.colors, &self.face_colors];
        let colors: usize = colors.into_iter().flatten().map(Colors::bytes).sum();
        let property = self.property.as_ref().map(|property| &property.values);
        let scalars: usize = self.alpha.iter().chain(property).map(Scalars::bytes).sum();
        let index_bytes = self.textures.as_ref().map_or(0, |all| size_of_val(&all.indices[..]));
        let normals = self.normals.as_ref().map_or(0, |all| size_of_val(&all[..])) + index_bytes;
        (positions + size_of_val(&self.triangles[..]) + normals + uvs + colors + scalars) as u64
    }

    /// Returns true if the file was read as points, without its faces.
    #[doc(hidden)]
    pub fn is_cloud(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Returns a flag for each vertex: true if a triangle uses it. In a cloud of points, all flags
    /// are true.
    #[doc(hidden)]
    pub fn used_vertices(&self) -> Vec<bool> {
        let count = self.positions.len();
        if self.is_cloud() {
            return vec![true; count];
        }
        let used: Vec<AtomicBool> = vec![false; count].into_iter().map(AtomicBool::new).collect();
        parallel::each(self.triangles.chunks(1 << 14), |triangles| {
            for &vertex in triangles.as_flattened() {
                used[vertex as usize].store(true, Relaxed);
            }
        });
        used.into_iter().map(AtomicBool::into_inner).collect()
    }
}

/// What the reader of a mesh file found, changed and dropped.
#[derive(Debug, Clone, Default)]
pub struct Notes {
    /// The encoding: `ascii`, `binary_little_endian` or `binary_big_endian`.
    pub format: &'static str,
    /// Number of faces in the file, before polygons are split. Every triangle of a strip counts as
    /// a face.
    pub faces: u64,
    /// Number of faces with more than three corners. They were split, or dropped by `--repair`.
    pub polygons_split: u64,
    /// Number of faces with fewer than three corners. They were skipped.
    pub faces_too_small: u64,
    /// Number of lines `comment TextureFile NAME`; 1 if all triangles have the same `texnumber`.
    pub texture_files: usize,
    /// Number of triangles that repeat a vertex or have zero area. They are not in
    /// [`Mesh::triangles`]. [`Mesh::stitches`] has those that close T-junctions.
    pub degenerate_dropped: u64,
    /// Number of triangles with the same three vertices, in any order, as an earlier one. They were
    /// dropped.
    pub duplicates_dropped: u64,
    /// Number of triangles dropped by `--repair`: they use a missing or non-finite vertex. In a
    /// cloud of points, the number of dropped points.
    pub repaired_dropped: u64,
    /// Number of faces that lost a `texnumber` out of range, with `repair`.
    pub textures_repaired: u64,
    /// Number of different textures that triangles select by `texnumber`. The value -1, no texture,
    /// is not counted.
    pub textures: u64,
    /// True if the alpha of all colours is 0. It is ignored, because the writer did not set it.
    pub alpha_ignored: bool,
    /// Number of bytes after the last row. The header may declare too few rows.
    pub trailing_bytes: u64,
    /// Identity and time stamp of the file when it was opened. `None` for a pipe.
    pub stamp: Option<Stamp>,
    /// Names `element.property` of the properties that were used, in file order.
    pub used: Vec<String>,
    /// Names `element.property` of the properties that were skipped, in file order.
    pub ignored: Vec<String>,
}
