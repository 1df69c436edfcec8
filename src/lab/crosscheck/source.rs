//! Sources of aimed rays.

/// Source of aimed rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// Rays from anywhere in any direction.
    Random,
    /// Rays through corners of primitives.
    Vertex,
    /// Rays through points on edges.
    Edge,
    /// Rays along an axis, mostly through a corner.
    Axis,
    /// Rays from a face of a primitive's bounding box, often within that face.
    BoxFace,
    /// Rays from 10 to 10^4 times the size of a mesh away.
    Far,
    /// Rays with a direction of length 1e-37 to 1e-30.
    Tiny,
}

impl Source {
    /// All sources, in the order of reports.
    pub const ALL: [Self; 7] =
        [Self::Random, Self::Vertex, Self::Edge, Self::Axis, Self::BoxFace, Self::Far, Self::Tiny];

    /// Name of the source in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Vertex => "vertex",
            Self::Edge => "edge",
            Self::Axis => "axis",
            Self::BoxFace => "box-face",
            Self::Far => "far",
            Self::Tiny => "tiny",
        }
    }
}
