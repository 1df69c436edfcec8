//! `lightpath._lightpath`: the native module of the Python package `lightpath`. The package
//! converts arrays and checks their shapes. This module releases the GIL, calls the library and
//! converts its errors to exceptions.

mod arrays;
mod errors;
mod mesh;
mod picture;
mod pools;
mod program;
mod scene;
mod watch;

use pyo3::prelude::*;

#[pymodule]
fn _lightpath(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<errors::Error>())?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<picture::Picture>()?;
    module.add_class::<picture::Views>()?;
    module.add_function(wrap_pyfunction!(mesh::check_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(mesh::read_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(program::main, module)?)
}
