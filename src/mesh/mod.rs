//! Meshes: the arrays and the reader of PLY files.

#[allow(clippy::module_inception)]
mod mesh;

pub use mesh::*;
