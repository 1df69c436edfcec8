//! Triangle meshes: their arrays, the PLY reader, and smooth vertex normals.

mod arrays;
mod creases;
mod normals;
mod ply;

pub use arrays::*;
pub use creases::{Normals, creased_normals};
pub use normals::{Point, vertex_normals};
pub use ply::{
    ElementSummary, PlySummary, PropertySummary, ReadOptions, Scalar, TriangleCount,
    inspect as inspect_ply, read as read_ply, read_bytes as read_ply_bytes,
};
