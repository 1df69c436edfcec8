//! Kinds of rays by where they come from.

use crate::measure::rays::Class;

/// Where rays come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// The scene's own of a class.
    Scene(Class),
    /// Anywhere in any direction.
    Random,
    /// Through corners of primitives.
    Vertex,
    /// Through points on edges.
    Edge,
    /// Along an axis, mostly through a corner.
    Axis,
    /// From a face of a primitive's box, often within that face.
    BoxFace,
    /// From 10 to 10^4 times the size of a mesh away from it.
    Far,
    /// Of a direction of length 1e-37 to 1e-30.
    Tiny,
}

impl Source {
    /// The aimed ones, in the order of reports.
    pub const AIMED: [Self; 7] =
        [Self::Random, Self::Vertex, Self::Edge, Self::Axis, Self::BoxFace, Self::Far, Self::Tiny];

    /// As reports name it.
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
