//! Sources of the rays of a check.

use crate::lab::rays::Class;

/// Source of rays: the scene's own, or a kind of aimed rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// Recorded rays of the scene, of one class.
    Scene(Class),
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
    /// All aimed sources, in the order of reports.
    pub const AIMED: [Self; 7] =
        [Self::Random, Self::Vertex, Self::Edge, Self::Axis, Self::BoxFace, Self::Far, Self::Tiny];

    /// Name of the source in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene(class) => class.name(),
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
