//! What tests need beside the independent ray tracer (`tests/reference/`), which they see here, too.

pub mod analytic;
pub mod assets;
pub mod compare;
pub mod program;

pub use lightpath_reference::{Density, Picture, render, scene};
