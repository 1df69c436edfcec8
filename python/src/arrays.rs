//! Converts numpy arrays to slices, and `Vec`s to numpy arrays.

use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// A borrowed array of f64 with two dimensions. [`rows`] checks that it is (n, 3) in C order.
pub type Triples<'py> = PyReadonlyArray2<'py, f64>;

/// Returns the rows of an (n, 3) array, without a copy.
///
/// # Errors
/// `ValueError` for another number of columns, or an array that is not in C order.
pub fn rows<'a, T: Element>(array: &'a PyReadonlyArray2<'_, T>) -> PyResult<&'a [[T; 3]]> {
    let [rows, columns] = *array.shape() else {
        return Err(PyValueError::new_err("expected an array of two dimensions"));
    };
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err("expected an array in C order"));
    }
    let flat = array.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
    if columns != 3 || flat.len() != rows * 3 {
        return Err(PyValueError::new_err(format!(
            "found the shape ({rows}, {columns}), expected (n, 3)"
        )));
    }
    // SAFETY: the slice has 3 * `rows` elements, and [T; 3] has the layout of three elements.
    Ok(unsafe { std::slice::from_raw_parts(flat.as_ptr().cast(), rows) })
}

/// Reserves memory for `count` elements of a new `Vec`.
///
/// # Errors
/// `MemoryError` if the system refuses the memory.
pub fn reserved<T>(count: usize, what: &str) -> PyResult<Vec<T>> {
    let mut all = Vec::new();
    let lack = |_| PyMemoryError::new_err(format!("no memory for {what}"));
    all.try_reserve_exact(count).map_err(lack)?;
    Ok(all)
}

/// Returns an array of one dimension with a copy of `values`.
///
/// # Errors
/// `MemoryError` if the system refuses the memory.
pub fn copied<'py, T: Element + Copy>(
    py: Python<'py>,
    values: &[T],
    what: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let mut own = reserved(values.len(), what)?;
    own.extend_from_slice(values);
    Ok(column(py, own))
}

/// Returns an (n, N) array that takes over the memory of `rows`.
pub fn table<'py, T: Element, const N: usize>(
    py: Python<'py>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = [rows.len(), N];
    Ok(PyArray1::from_vec(py, rows.into_flattened()).reshape(shape)?.into_any())
}

/// Returns an array of one dimension that takes over the memory of `values`.
pub fn column<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyAny> {
    PyArray1::from_vec(py, values).into_any()
}
