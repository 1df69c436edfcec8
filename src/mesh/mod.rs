//! Meshes: the arrays, the reader of PLY files, and smooth normals.

#[allow(clippy::module_inception)]
mod mesh;
mod normals;
mod ply;

pub use mesh::*;
pub use normals::{Point, vertex_normals};
pub use ply::{
    ElementSummary, PlySummary, PropertySummary, ReadOptions, Scalar, TriangleCount,
    inspect as inspect_ply, read as read_ply, read_bytes as read_ply_bytes,
};
