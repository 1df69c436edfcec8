//! Converts numpy arrays to slices, and `Vec`s to numpy arrays.

use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A borrowed array of f64 with two dimensions. [`rows`] checks that it is (n, 3) in C order.
pub type Triples<'py> = PyReadonlyArray2<'py, f64>;

/// Returns the rows of an (n, 3) array, without a copy.
///
/// # Errors
/// `ValueError` for another number of columns, or an array that is not in C order.
pub fn rows<'a, T: Element>(array: &'a PyReadonlyArray2<'_, T>) -> PyResult<&'a [[T; 3]]> {
    let [rows, columns] = *array.as_array().shape() else {
        return Err(PyValueError::new_err("expected an array of two dimensions"));
    };
    let flat = array.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))?;
    if columns != 3 || flat.len() != rows * 3 {
        return Err(PyValueError::new_err(format!(
            "found the shape ({rows}, {columns}), expected (n, 3)"
        )));
    }
    // SAFETY: the slice has 3 * `rows` elements, and [T; 3] has the layout of three elements.
    Ok(unsafe { std::slice::from_raw_parts(flat.as_ptr().cast(), rows) })
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
