//! Triangle meshes: their arrays, the PLY reader, and smooth vertex normals.

mod arrays;
mod check;
mod closing;
mod creases;
mod normals;
mod places;
mod ply;
mod shared_edges;
mod stitched_edges;
mod stitches;
mod vertex_faces;

pub use arrays::*;
pub use closing::{closing_stitches, stitching_bytes};
pub use creases::{Normals, creased_normals};
pub use normals::{VertexPosition, vertex_normals};
pub use places::position_key;
pub use ply::{
    ColorChoice, ColorRequest, ElementSummary, PlySummary, PropertySummary, ReadOptions, Scalar,
    TriangleCount, inspect as inspect_ply, inspect_with as inspect_ply_with, read as read_ply,
    read_bytes as read_ply_bytes,
};
pub use stitches::kept_stitches;

use std::path::Path;

use crate::error::Result;
use crate::monitor::Monitor;

impl Mesh {
    /// Reads a PLY file, plain or compressed with gzip or zstd, on the threads of the current rayon
    /// pool. A regular file is mapped into memory where a handler of SIGBUS can be installed, for
    /// files that get shorter while they are read. It calls the handler that was there before for
    /// the faults of others. A pipe blocks until its writer ends.
    ///
    /// # Errors
    /// If the file cannot be read, is not a valid PLY file, or holds no triangle. Also if a
    /// triangle uses a missing or non-finite vertex.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        read_ply(path.as_ref(), ReadOptions::default())
    }

    /// [`Mesh::read`] with a monitor that can stop it, but not while it waits for a pipe.
    ///
    /// # Errors
    /// As [`Mesh::read`]; `Interrupted` if the monitor was stopped.
    pub fn read_watched(path: impl AsRef<Path>, monitor: &Monitor) -> Result<Self> {
        read_ply(path.as_ref(), ReadOptions { monitor: Some(monitor), ..ReadOptions::default() })
    }
}
