//! The command-line program.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;

/// Runs the program `lightpath` and returns its exit code. `words` are its name and its arguments.
/// `program` is the file that other machines run.
#[pyfunction]
pub fn main(py: Python<'_>, words: Vec<OsString>, program: PathBuf) -> u8 {
    py.detach(|| lightpath::cli::main(&words, Some(&program)))
}
