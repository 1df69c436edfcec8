//! What tests need beside the independent ray tracer, which is a crate (`tests/reference/`).

pub mod analytic;
pub mod assets;
pub mod compare;
pub mod program;
