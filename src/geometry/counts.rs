//! How many primitives an accelerator is built over.

use super::mesh::TriangleMesh;
use super::primitives::Geometry;
use crate::ray::RayKind;

/// The primitives that an accelerator is built over.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PrimitiveCounts {
    /// Number of triangles and spheres.
    pub primitives: u64,
    /// Number of vertices of meshes beyond half a vertex per triangle, which is what a closed mesh
    /// has whose triangles share their vertices.
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

impl Geometry {
    /// Returns what is in all accelerators: one for each distinct set of primitives that a kind of
    /// ray can hit. A shared mesh counts once for each accelerator, and each of its instances as
    /// one primitive. The loose vertices are an upper bound if a kind of ray cannot hit a mesh.
    pub fn accelerated(&self) -> PrimitiveCounts {
        let own = 0..self.own_count();
        let shared = self.shared.iter().map(Geometry::count).sum::<u64>();
        let placed = shared + self.instances.len() as u64;
        let loose = |mesh: &TriangleMesh| {
            let [triangles, vertices] = [mesh.triangles().len(), mesh.vertices().len()];
            PrimitiveCounts::of_mesh(triangles as u64, vertices as u64).loose_vertices
        };
        let meshes = self.shared.iter().flat_map(|geometry| &geometry.meshes).chain(&self.meshes);
        let loose_vertices = meshes.map(loose).sum();
        let unseen = RayKind::ALL.map(|kind| self.unseen(kind));
        let distinct = (0..unseen.len()).filter(|&k| !unseen[..k].contains(&unseen[k]));
        let counts = distinct.map(|k| PrimitiveCounts {
            primitives: u64::from(own.end - unseen[k].count(&own)) + placed,
            loose_vertices,
        });
        counts.fold(PrimitiveCounts::default(), PrimitiveCounts::plus)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Triangles that share no vertex have two and a half loose ones each. The triangles of a
    /// tetrahedron have half a vertex too many. A vertex that no triangle can use does not count.
    #[test]
    fn vertices_count_beyond_half_a_vertex_per_triangle() {
        let loose = |vertices: usize, triangles: Vec<[u32; 3]>| {
            let vertices = (0..vertices).map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
            let mesh = TriangleMesh::new(vertices, triangles, false);
            let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
            geometry.accelerated().loose_vertices
        };
        assert_eq!(loose(6, vec![[0, 1, 2], [3, 4, 5]]), 5);
        assert_eq!(loose(4, vec![[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]), 2);
        assert_eq!(loose(99, vec![[0, 1, 2], [3, 4, 5]]), 5);
    }

    #[test]
    fn copies_count_as_often_as_there_are_copies() {
        let counts = PrimitiveCounts { primitives: 3, loose_vertices: 5 };
        assert_eq!(counts.times(4), PrimitiveCounts { primitives: 12, loose_vertices: 20 });
        let most = PrimitiveCounts { primitives: u64::MAX, loose_vertices: u64::MAX };
        assert_eq!(counts.times(u64::MAX), most);
    }
}
