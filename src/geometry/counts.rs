//! How many primitives an accelerator is built over.

/// The primitives that an accelerator is built over.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PrimitiveCounts {
    /// Number of triangles and spheres.
    pub primitives: u64,
    /// Number of vertices beyond half a vertex per triangle: those of a closed mesh whose triangles
    /// share them.
    pub loose_vertices: u64,
}

impl PrimitiveCounts {
    /// Counts primitives that share vertices as in a closed mesh, or have none.
    pub fn new(primitives: u64) -> Self {
        Self { primitives, loose_vertices: 0 }
    }

    /// Counts a mesh. Vertices that no triangle can use do not count.
    pub fn of_mesh(triangles: u64, vertices: u64) -> Self {
        let used = vertices.min(triangles.saturating_mul(3));
        Self { primitives: triangles, loose_vertices: used.saturating_sub(triangles / 2) }
    }

    /// Adds the primitives of others.
    pub fn plus(self, other: Self) -> Self {
        Self {
            primitives: self.primitives.saturating_add(other.primitives),
            loose_vertices: self.loose_vertices.saturating_add(other.loose_vertices),
        }
    }

    /// Counts all primitives `times` times.
    pub fn times(self, times: u64) -> Self {
        Self {
            primitives: self.primitives.saturating_mul(times),
            loose_vertices: self.loose_vertices.saturating_mul(times),
        }
    }
}
