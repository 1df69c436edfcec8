//! Sources of aimed rays.

use crate::lab::named::named;

named! {
    /// Source of aimed rays.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum RaySource {
        /// Rays from anywhere in any direction.
        Random = "random",
        /// Rays through corners of primitives.
        Vertex = "vertex",
        /// Rays through points on edges.
        Edge = "edge",
        /// Rays along an axis, mostly through a corner.
        Axis = "axis",
        /// Rays from a face of a primitive's bounding box, often within that face.
        BoxFace = "box-face",
        /// Rays from 10 to 10^4 times the size of a mesh away.
        Far = "far",
        /// Rays with a direction of length 1e-37 to 1e-30.
        Tiny = "tiny",
    }
}
