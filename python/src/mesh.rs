//! Meshes whose vertices and faces stay in the memory of numpy arrays.

use lightpath::{Colors, Faces, Mesh, MeshArrays, Monitor, Positions, Scalars, Vertices};
use numpy::{Element, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyMemoryError, PyTypeError};
use pyo3::prelude::*;

use crate::{arrays, pools, watch};

/// The rows of a numpy array, and a reference that keeps the array alive.
struct Rows<T> {
    start: *const [T; 3],
    len: usize,
    /// Keeps the memory alive.
    _array: Py<PyAny>,
}

// SAFETY: the memory is only read, by any thread, and lives as long as `_array`.
unsafe impl<T: Sync> Send for Rows<T> {}
// SAFETY: see above.
unsafe impl<T: Sync> Sync for Rows<T> {}

impl<T: Element> Rows<T> {
    fn new(array: &Bound<'_, PyAny>) -> Option<PyResult<Self>> {
        let array = array.cast::<PyArray2<T>>().ok()?;
        let rows = |array: &Bound<'_, PyArray2<T>>| {
            let read: PyReadonlyArray2<'_, T> = array.try_readonly()?;
            let rows = arrays::rows(&read)?;
            // Not from the slice, which is borrowed: Python may write to the array between queries.
            // An empty array may have no aligned memory.
            let start =
                if rows.is_empty() { rows.as_ptr() } else { array.data().cast_const().cast() };
            Ok(Self { start, len: rows.len(), _array: array.clone().into() })
        };
        Some(rows(array))
    }

    fn get(&self) -> &[[T; 3]] {
        // SAFETY: `_array` owns the memory. The documentation forbids resizing the array or writing
        // to it while a scene uses it. Indices are checked at every use.
        unsafe { std::slice::from_raw_parts(self.start, self.len) }
    }
}

enum VertexRows {
    F32(Rows<f32>),
    F64(Rows<f64>),
}

enum FaceRows {
    U32(Rows<u32>),
    I32(Rows<i32>),
    U64(Rows<u64>),
    I64(Rows<i64>),
}

/// A mesh in two numpy arrays: vertices and faces.
pub struct NumpyMesh {
    vertices: VertexRows,
    faces: FaceRows,
}

impl NumpyMesh {
    /// Takes an (n, 3) array of f32 or f64 and an (m, 3) array of 32-bit or 64-bit integers, both
    /// in C order, without a copy.
    ///
    /// # Errors
    /// `TypeError` for another dtype, `ValueError` for another shape or order.
    pub fn new(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<Self> {
        let other = |name: &str| PyTypeError::new_err(format!("{name}: not an array of its type"));
        let vertices = if let Some(rows) = Rows::new(vertices) {
            VertexRows::F32(rows?)
        } else {
            VertexRows::F64(Rows::new(vertices).ok_or_else(|| other("vertices"))??)
        };
        let faces = if let Some(rows) = Rows::new(faces) {
            FaceRows::U32(rows?)
        } else if let Some(rows) = Rows::new(faces) {
            FaceRows::I32(rows?)
        } else if let Some(rows) = Rows::new(faces) {
            FaceRows::U64(rows?)
        } else {
            FaceRows::I64(Rows::new(faces).ok_or_else(|| other("faces"))??)
        };
        Ok(Self { vertices, faces })
    }
}

impl MeshArrays for NumpyMesh {
    fn vertices(&self) -> Vertices<'_> {
        match &self.vertices {
            VertexRows::F32(rows) => Vertices::F32(rows.get()),
            VertexRows::F64(rows) => Vertices::F64(rows.get()),
        }
    }

    fn faces(&self) -> Faces<'_> {
        match &self.faces {
            FaceRows::U32(rows) => Faces::U32(rows.get()),
            FaceRows::I32(rows) => Faces::I32(rows.get()),
            FaceRows::U64(rows) => Faces::U64(rows.get()),
            FaceRows::I64(rows) => Faces::I64(rows.get()),
        }
    }
}

/// Colours of vertices.
#[derive(Clone)]
pub struct VertexColors {
    pub colors: Colors,
    /// `None` if all vertices are opaque, or none is visible: as in a PLY file.
    pub alpha: Option<Scalars>,
}

impl VertexColors {
    /// Copies an (n, 4) array of u8 or u16.
    ///
    /// # Errors
    /// `TypeError` for another dtype, `MemoryError` for too little memory.
    pub fn new(array: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(array) = array.cast::<PyArray2<u8>>() {
            let (colors, alpha) = split(array, u8::MAX)?;
            return Ok(Self { colors: Colors::U8(colors), alpha: alpha.map(Scalars::U8) });
        }
        let array = array.cast::<PyArray2<u16>>()?;
        let (colors, alpha) = split(array, u16::MAX)?;
        Ok(Self { colors: Colors::U16(colors), alpha: alpha.map(Scalars::U16) })
    }
}

/// Three columns of colours, and one of alpha.
type Columns<T> = (Vec<[T; 3]>, Option<Vec<T>>);

/// Splits the rows of an (n, 4) array into colours and alpha.
fn split<T: Element + Copy + Default + PartialEq>(
    array: &Bound<'_, PyArray2<T>>,
    opaque: T,
) -> PyResult<Columns<T>> {
    let read = array.try_readonly()?;
    let rows = read.as_slice()?.chunks_exact(4);
    let mut colors = arrays::reserved(rows.len(), "colors")?;
    colors.extend(rows.clone().map(|row| [row[0], row[1], row[2]]));
    let mut alpha: Vec<T> = arrays::reserved(rows.len(), "colors")?;
    alpha.extend(rows.map(|row| row[3]));
    let all = |value| alpha.iter().all(|&alpha| alpha == value);
    let alpha = if all(opaque) || all(T::default()) { None } else { Some(alpha) };
    Ok((colors, alpha))
}

/// Raises the exceptions that a scene of this mesh would raise.
#[pyfunction]
pub fn check_mesh(
    py: Python<'_>,
    vertices: &Bound<'_, PyAny>,
    faces: &Bound<'_, PyAny>,
    threads: Option<usize>,
) -> PyResult<()> {
    let mesh = NumpyMesh::new(vertices, faces)?;
    let pool = pools::pool(py, threads)?;
    watch::run(py, &pool, mesh.faces().len(), None, |_| mesh.check(""))
}

/// Reads the vertices and triangles of a PLY file: (n, 3) f32 or f64, and (m, 3) u32. The
/// triangles without area that close T-junctions are the last ones.
#[pyfunction]
pub fn read_mesh<'py>(
    py: Python<'py>,
    path: std::path::PathBuf,
    threads: Option<usize>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let pool = pools::pool(py, threads)?;
    let read = |monitor: &Monitor| Mesh::read_watched(&path, monitor);
    let mesh = watch::run(py, &pool, usize::MAX, None, read)?;
    let mut triangles = mesh.triangles;
    triangles
        .try_reserve_exact(mesh.stitches.len())
        .map_err(|_| PyMemoryError::new_err("no memory for faces"))?;
    triangles.extend_from_slice(&mesh.stitches);
    let vertices = match mesh.positions {
        Positions::F32(all) => arrays::table(py, all)?,
        Positions::F64(all) => arrays::table(py, all)?,
    };
    Ok((vertices, arrays::table(py, triangles)?))
}
