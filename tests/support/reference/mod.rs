//! What tests need beside the independent ray tracer (`tests/reference/`), which they see here,
//! too.

pub mod analytic;
pub mod assets;
pub mod compare;
pub mod program;

#[allow(unused_imports)] // each test program uses its own part of this crate
pub use lightpath_reference::{Density, Picture, render, scene};
