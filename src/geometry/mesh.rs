//! A triangle mesh as the accelerators read it.

use std::sync::OnceLock;

use crate::parallel;

use super::placement::Placement;

/// Number of triangles in a [run](TriangleMesh::runs).
pub const RUN: usize = 256;

/// Triangles over shared vertices; f32, relative to [`Geometry::origin`](super::Geometry::origin).
#[derive(Debug, Default)]
pub struct TriangleMesh {
    /// One unused element is at the end, because Embree reads 16 bytes from each vertex.
    pub(super) vertices: Vec<[f32; 3]>,
    /// Vertex indices, each below `vertices().len()`.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The last `stitches.len()` triangles are stitches. For each of them, the triangle beside it.
    pub(super) stitches: Vec<u32>,
    /// True for `bvh: false` in the scene: the `coursework` backend tests each triangle of the mesh
    /// in a loop.
    pub loop_only: bool,
    /// Lowest and highest finite coordinates of all vertices.
    bounds: [[f32; 3]; 2],
    /// See [`TriangleMesh::runs`]; made at the first use.
    pub(super) runs: OnceLock<Vec<[[f32; 3]; 2]>>,
}

impl TriangleMesh {
    /// Creates a mesh without stitches, in the current rayon pool. Every index must be below the
    /// number of vertices.
    pub fn new(mut vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>, loop_only: bool) -> Self {
        debug_assert!(triangles.iter().flatten().all(|&i| (i as usize) < vertices.len()));
        let bounds = bounds_of(&vertices);
        vertices.reserve_exact(1);
        vertices.push([0.0; 3]);
        let (stitches, runs) = (Vec::new(), OnceLock::new());
        Self { vertices, triangles, stitches, loop_only, bounds, runs }
    }

    /// Returns a copy of the mesh in the scene.
    #[must_use]
    pub fn placed(&self, placement: &Placement) -> Self {
        let all = self.vertices();
        let vertices = parallel::values(all.len(), |i| placement.place(all[i]));
        let triangles = self.triangles.clone();
        let placed = Self::new(vertices, triangles, self.loop_only);
        Self { stitches: self.stitches.clone(), ..placed }
    }

    /// Vertex positions, without the padding element.
    pub fn vertices(&self) -> &[[f32; 3]] {
        self.vertices.split_last().map_or(&[], |(_, rest)| rest)
    }

    /// Vertex positions and the unused padding element behind them.
    pub fn padded_vertices(&self) -> &[[f32; 3]] {
        &self.vertices
    }

    /// Vertex indices of each triangle, stitches included.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Corners of triangle `prim`.
    #[inline(always)]
    pub fn corners(&self, prim: u32) -> [[f32; 3]; 3] {
        let [a, b, c] = self.triangles[prim as usize];
        [self.vertices[a as usize], self.vertices[b as usize], self.vertices[c as usize]]
    }

    /// Lowest and highest coordinates of all vertices, used or not. Those that are not finite are
    /// ignored: no triangle has them. Without any the lowest are `+inf` and the highest `-inf`.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        self.bounds
    }

    /// Lowest and highest coordinates of each [`RUN`] triangles in order, stitches included. They
    /// are computed at the first call, in the current rayon pool if there is one.
    pub fn runs(&self) -> &[[[f32; 3]; 2]] {
        let of_run = |run: usize| {
            let end = self.triangles.len().min((run + 1) * RUN);
            let corners = (run * RUN..end).flat_map(|prim| self.corners(prim as u32));
            corners.fold(NOTHING, |all, corner| union(all, [corner; 2]))
        };
        if let Some(known) = self.runs.get() {
            return known;
        }
        // Outside of the cell: a thread that waits for others may begin a task that needs it, too.
        let count = self.triangles.len().div_ceil(RUN);
        let all = match rayon::current_thread_index() {
            Some(_) => parallel::values(count, of_run),
            // Outside of any pool, parallel code would start rayon's global one.
            None => (0..count).map(of_run).collect(),
        };
        self.runs.get_or_init(|| all)
    }

    /// Memory of all arrays but the small one of the runs, in bytes.
    pub fn bytes(&self) -> u64 {
        let indices = size_of_val(&self.triangles[..]) + size_of_val(&self.stitches[..]);
        (size_of_val(&self.vertices[..]) + indices) as u64
    }
}

/// Bounds around nothing.
const NOTHING: [[f32; 3]; 2] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// Returns the bounds of two bounds, without coordinates that are not finite.
#[inline(always)]
fn union([low, high]: [[f32; 3]; 2], [a, b]: [[f32; 3]; 2]) -> [[f32; 3]; 2] {
    let lower = |k: usize| a[k] < low[k] && a[k] > f32::NEG_INFINITY;
    let higher = |k: usize| b[k] > high[k] && b[k] < f32::INFINITY;
    let least = std::array::from_fn(|k| if lower(k) { a[k] } else { low[k] });
    [least, std::array::from_fn(|k| if higher(k) { b[k] } else { high[k] })]
}

fn bounds_of(vertices: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let of_chunk = |chunk: &[[f32; 3]]| chunk.iter().fold(NOTHING, |all, &v| union(all, [v; 2]));
    parallel::map(vertices.chunks(1 << 16), of_chunk).into_iter().fold(NOTHING, union)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn bounds_contain_all_finite_coordinates() {
        let mut vertices = vec![[1.0, -2.0, 3.0], [-4.0, 5.0, -6.0]];
        vertices.extend([[f32::NAN, 7.0, -f32::INFINITY], [f32::INFINITY; 3]]);
        let mesh = TriangleMesh::new(vertices, vec![], false);
        assert_eq!(mesh.bounds(), [[-4.0, -2.0, -6.0], [1.0, 7.0, 3.0]]);
        let nothing = TriangleMesh::new(vec![], vec![], false).bounds();
        assert_eq!(nothing, [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]);
    }

    #[test]
    fn runs_are_around_their_triangles() {
        let at = |i: usize| [i as f32, -(i as f32), 0.5];
        let vertices = (0..3 * RUN).map(at).collect();
        let triangles = (0..RUN as u32 + 2).map(|i| [i, i + 1, i + 2]).collect();
        let mesh = TriangleMesh::new(vertices, triangles, false);
        let last = RUN as f32;
        let around = |low: f32, high: f32| [[low, -high, 0.5], [high, -low, 0.5]];
        assert_eq!(mesh.runs(), [around(0.0, last + 1.0), around(last, last + 3.0)]);
        // A stitch comes into the last run.
        let mesh = mesh.with_stitches(&[[0, 2, 1]]);
        assert_eq!(mesh.runs()[mesh.runs().len() - 1][0][0], 0.0);
        assert!(TriangleMesh::default().runs().is_empty());
    }

    #[test]
    fn a_copy_keeps_the_stitches_and_memory_is_that_of_the_arrays() {
        let vertices = vec![[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [1.0, 0.0, 0.0]];
        let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2]], true).with_stitches(&[[0, 3, 1]]);
        let copy = mesh.placed(&Placement::new(DMat3::IDENTITY, DVec3::X));
        assert_eq!((copy.stitches(), copy.triangles()), (1, mesh.triangles()));
        assert!(copy.loop_only);
        assert_eq!(copy.vertices()[3], [2.0, 0.0, 0.0]);
        // Four vertices and the padding, a triangle and the stitch, its neighbour.
        assert_eq!(mesh.bytes(), 5 * 12 + 2 * 12 + 4);
        assert_eq!(copy.bytes(), mesh.bytes());
    }
}
