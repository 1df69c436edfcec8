//! Sources of aimed rays.

use crate::lab::named::named;

named! {
    /// Source of aimed rays: where they start and what they are aimed at.
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
        /// Rays from the plane of a face of a primitive's bounding box, often along that plane.
        BoxFace = "box-face",
        /// Rays from 10 to 10^4 times half the size of their target's geometry away.
        Far = "far",
        /// Rays with a direction of length 1e-37 to 1e-30, longer only to keep t in the range of
        /// f32.
        Tiny = "tiny",
    }
}
