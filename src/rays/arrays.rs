//! The arrays of a mesh, which stay with the caller in the types that they have there.

use glam::DVec3;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::geometry::Box3;
use crate::mesh::{Mesh, Positions};
use crate::parallel;
use crate::reserve;
use crate::simd::prefetch;

/// Largest magnitude of a coordinate.
const MAX_COORDINATE: f64 = 1e18;

/// Largest number of vertices: the tree has indices of 32 bits.
const MAX_VERTICES: u64 = 1 << 32;

/// The caller's array of vertex positions.
#[derive(Debug, Clone, Copy)]
pub enum Vertices<'a> {
    /// Single precision.
    F32(&'a [[f32; 3]]),
    /// Double precision.
    F64(&'a [[f64; 3]]),
}

impl Vertices<'_> {
    /// Returns the number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(all) => all.len(),
            Self::F64(all) => all.len(),
        }
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Prefetches the first cache line of a vertex. The index may be out of bounds.
    #[inline(always)]
    pub(super) fn prefetch(&self, i: usize) {
        match self {
            Self::F32(all) => prefetch(all, i),
            Self::F64(all) => prefetch(all, i),
        }
    }

    /// Position of a vertex; `None` beyond the last one.
    #[inline(always)]
    pub(super) fn get(&self, i: usize) -> Option<DVec3> {
        match self {
            Self::F32(all) => {
                let [x, y, z] = *all.get(i)?;
                Some(DVec3::new(x.into(), y.into(), z.into()))
            }
            Self::F64(all) => Some(DVec3::from(*all.get(i)?)),
        }
    }
}

/// Vertex indices of triangles.
#[derive(Debug, Clone, Copy)]
pub enum Faces<'a> {
    /// Unsigned 32-bit indices.
    U32(&'a [[u32; 3]]),
    /// Signed 32-bit indices.
    I32(&'a [[i32; 3]]),
    /// Unsigned 64-bit indices.
    U64(&'a [[u64; 3]]),
    /// Signed 64-bit indices.
    I64(&'a [[i64; 3]]),
    /// Unsigned 32-bit indices in two arrays, numbered one after the other.
    U32Pair(&'a [[u32; 3]], &'a [[u32; 3]]),
}

impl Faces<'_> {
    /// Returns the number of triangles.
    pub fn len(&self) -> usize {
        match self {
            Self::U32(all) => all.len(),
            Self::I32(all) => all.len(),
            Self::U64(all) => all.len(),
            Self::I64(all) => all.len(),
            Self::U32Pair(all, more) => all.len() + more.len(),
        }
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Prefetches the first cache line of a triangle. The index may be out of bounds.
    #[inline(always)]
    pub(super) fn prefetch(&self, i: usize) {
        match self {
            Self::U32(all) => prefetch(all, i),
            Self::I32(all) => prefetch(all, i),
            Self::U64(all) => prefetch(all, i),
            Self::I64(all) => prefetch(all, i),
            Self::U32Pair(all, _) => prefetch(all, i),
        }
    }

    /// Vertex indices of a triangle; `None` for a negative index.
    #[inline(always)]
    pub(super) fn get(&self, i: usize) -> [Option<u64>; 3] {
        // Without closures, which would be called.
        match self {
            Self::U32(all) => {
                let [a, b, c] = all[i];
                [Some(a.into()), Some(b.into()), Some(c.into())]
            }
            Self::I32(all) => {
                let [a, b, c] = all[i];
                [a.try_into().ok(), b.try_into().ok(), c.try_into().ok()]
            }
            Self::U64(all) => {
                let [a, b, c] = all[i];
                [Some(a), Some(b), Some(c)]
            }
            Self::I64(all) => {
                let [a, b, c] = all[i];
                [a.try_into().ok(), b.try_into().ok(), c.try_into().ok()]
            }
            Self::U32Pair(all, more) => {
                let [a, b, c] = if i < all.len() { all[i] } else { more[i - all.len()] };
                [Some(a.into()), Some(b.into()), Some(c.into())]
            }
        }
    }

    /// An index as the caller wrote it.
    fn written(&self, i: usize, k: usize) -> i128 {
        match self {
            Self::U32(all) => all[i][k].into(),
            Self::I32(all) => all[i][k].into(),
            Self::U64(all) => all[i][k].into(),
            Self::I64(all) => all[i][k].into(),
            Self::U32Pair(all, more) => {
                if i < all.len() {
                    all[i][k].into()
                } else {
                    more[i - all.len()][k].into()
                }
            }
        }
    }
}

/// The arrays of a triangle mesh.
///
/// They must not change while a [`RayScene`](super::RayScene) uses them. If they do, answers are
/// meaningless, but nothing else happens as long as their lengths stay.
pub trait MeshArrays: Send + Sync {
    /// Vertex positions. Those that no face uses are ignored.
    fn vertices(&self) -> Vertices<'_>;
    /// Vertex indices of the faces.
    fn faces(&self) -> Faces<'_>;

    /// Checks the arrays. `place` begins the places of errors.
    ///
    /// # Errors
    /// `Invalid`: no face, an index out of range, or a vertex of a face that is not finite or
    /// beyond 1e18.
    fn check(&self, place: &str) -> Result<()>
    where
        Self: Sized,
    {
        check(self, place).map(drop)
    }

    /// Copies the arrays to a mesh, without the faces that repeat a vertex. `place` begins the
    /// places of errors.
    ///
    /// # Errors
    /// - `Invalid`: no face of three different vertices, an index out of range, or a vertex of a
    ///   face that is not finite or beyond 1e18.
    /// - `Retry`: there is too little memory.
    fn to_mesh(&self, place: &str) -> Result<Mesh>
    where
        Self: Sized,
    {
        check(self, place)?;
        let positions = match self.vertices() {
            Vertices::F32(all) => Positions::F32(copy(all)?),
            Vertices::F64(all) => Positions::F64(copy(all)?),
        };
        let faces = self.faces();
        let mut triangles = Vec::new();
        reserve::exact(&mut triangles, faces.len(), "faces")?;
        // The caller's arrays may have changed since they were checked. `Mesh::new` refuses
        // `u32::MAX`.
        let narrow =
            |index: Option<u64>| index.map_or(u32::MAX, |v| v.try_into().unwrap_or(u32::MAX));
        let all = (0..faces.len()).map(|i| faces.get(i).map(narrow));
        triangles.extend(all.filter(|[a, b, c]| a != b && b != c && c != a));
        if triangles.is_empty() {
            let message = "found no face of three different vertices, expected at least one";
            return Err(Error::invalid(format!("{place}faces"), message));
        }
        let dropped = (faces.len() - triangles.len()) as u64;
        let mut mesh = Mesh::new(positions, triangles)?;
        mesh.notes.degenerate_dropped = dropped;
        Ok(mesh)
    }
}

fn copy<T: Copy>(all: &[T]) -> Result<Vec<T>> {
    let mut own = Vec::new();
    reserve::exact(&mut own, all.len(), "vertices")?;
    own.extend_from_slice(all);
    Ok(own)
}

impl MeshArrays for Mesh {
    fn vertices(&self) -> Vertices<'_> {
        match &self.positions {
            Positions::F32(all) => Vertices::F32(all),
            Positions::F64(all) => Vertices::F64(all),
        }
    }

    /// The triangles, then the stitches: without them rays would leak at T-junctions, and the mesh
    /// would be open.
    fn faces(&self) -> Faces<'_> {
        match &self.stitches[..] {
            [] => Faces::U32(&self.triangles),
            stitches => Faces::U32Pair(&self.triangles, stitches),
        }
    }
}

/// Corners of a face. NaN where an index is out of range.
#[inline(always)]
pub(super) fn corners(mesh: &dyn MeshArrays, face: usize) -> [DVec3; 3] {
    positions(mesh, mesh.faces().get(face))
}

/// Positions of the corners of a face. NaN where an index is out of range.
#[inline(always)]
pub(super) fn positions(mesh: &dyn MeshArrays, face: [Option<u64>; 3]) -> [DVec3; 3] {
    let vertices = mesh.vertices();
    let mut positions = [DVec3::NAN; 3];
    for (position, index) in positions.iter_mut().zip(face) {
        if let Some(vertex) = index.and_then(|i| vertices.get(i as usize)) {
            *position = vertex;
        }
    }
    positions
}

/// Checks that indices of 32 bits reach all vertices.
fn check_count(count: u64, place: &str) -> Result<()> {
    if count <= MAX_VERTICES {
        return Ok(());
    }
    let message = format!("found {count} vertices, expected at most {MAX_VERTICES}");
    Err(Error::new(ErrorKind::Limit, Problem::new(format!("{place}vertices"), message)))
}

/// Checks indices and vertices, and returns the box of the vertices that faces use.
pub(super) fn check(mesh: &dyn MeshArrays, place: &str) -> Result<Box3> {
    let (vertices, faces) = (mesh.vertices(), mesh.faces());
    let count = vertices.len();
    check_count(count as u64, place)?;
    if faces.is_empty() {
        return Err(Error::invalid(
            format!("{place}faces"),
            "found no face, expected at least one",
        ));
    }
    let vertex = |i: usize, k: usize| faces.get(i)[k].and_then(|v| vertices.get(v as usize));
    let sound = |v: DVec3| v.abs().max_element() <= MAX_COORDINATE && !v.is_nan();
    let bad = |i: usize| (0..3).any(|k| !vertex(i, k).is_some_and(sound));
    let parts = || parallel::ranges(faces.len(), 1 << 14);
    let found = parallel::map(parts(), |mut part| part.find(|&i| bad(i)));
    if let Some(i) = found.into_iter().flatten().next() {
        let k = (0..3).find(|&k| !vertex(i, k).is_some_and(sound)).unwrap_or(0);
        let index = faces.written(i, k);
        return Err(match vertex(i, k) {
            None => Error::invalid(
                format!("{place}faces[{i}, {k}]"),
                format!("found vertex {index}, expected 0 to {}", count as i128 - 1),
            ),
            Some(v) => Error::invalid(
                format!("{place}vertices[{index}]"),
                format!("found {:?}, expected finite numbers up to 1e18", v.to_array()),
            ),
        });
    }
    let boxes = parallel::map(parts(), |part| {
        part.fold(Box3::EMPTY, |all, i| all.union(Box3::of(&corners(mesh, i))))
    });
    Ok(boxes.into_iter().fold(Box3::EMPTY, Box3::union))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_of_32_bits_reach_all_vertices() {
        assert_eq!(check_count(1 << 32, ""), Ok(()));
        let error = check_count((1 << 32) + 1, "mesh 1: ").unwrap_err();
        assert_eq!(error.kind, ErrorKind::Limit);
        assert!(error.to_string().contains("mesh 1: vertices"), "{error}");
    }
}
