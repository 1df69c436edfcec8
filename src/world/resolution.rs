//! Measures how much detail a mesh keeps when its vertices are rounded to f32 relative to the
//! scene's origin.

use std::path::PathBuf;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::error::Problem;
use crate::geometry::{Placement, TriangleMesh};
use crate::parallel::{self, GRAIN};

/// Detail of a mesh in single precision relative to the scene's origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolution {
    /// Place in the scene file where the path of the mesh is written, for messages.
    pub place: String,
    /// Path of the mesh file.
    pub path: PathBuf,
    /// The measured detail.
    pub detail: Detail,
}

/// Detail of vertices in single precision, in world units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Detail {
    /// Distance between neighbouring f32 values at the farthest coordinate.
    pub ulp: f64,
    /// Shortest edge in the file that is longer than 0; infinite without such an edge, which JSON
    /// shows as null.
    pub shortest_edge: f64,
    /// Number of edges whose ends differ in the file but not in f32.
    pub collapsed_edges: u64,
}

impl Detail {
    /// Measures the edges of `triangles`, in parallel. `farthest` is the largest coordinate
    /// relative to the origin. `exact` returns a vertex in a space whose lengths are `1 / scale` of
    /// the world's. `rounded` maps such a vertex to f32.
    pub fn new(
        farthest: f64,
        triangles: &[[u32; 3]],
        scale: f64,
        exact: impl Fn(u32) -> DVec3 + Sync,
        rounded: impl Fn(DVec3) -> [f32; 3] + Sync,
    ) -> Self {
        let found = parallel::map(triangles.chunks(GRAIN), |triangles| {
            let mut all = Edges::default();
            for t in triangles {
                let at = t.map(&exact);
                let seen = at.map(&rounded);
                for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                    all.see(at[i].distance_squared(at[j]));
                    if seen[i] == seen[j] && at[i] != at[j] {
                        all.collapsed.push([t[i].min(t[j]), t[i].max(t[j])]);
                    }
                }
            }
            all
        });
        let found = found.into_iter().fold(Edges::default(), Edges::with);
        let Edges { shortest_squared, collapsed } = found;
        let shortest_edge = shortest_squared.sqrt() * scale;
        Self { ulp: ulp(farthest), shortest_edge, collapsed_edges: count_once(collapsed) }
    }

    /// Returns the detail of two meshes together.
    pub fn worse(self, other: Self) -> Self {
        Self {
            ulp: self.ulp.max(other.ulp),
            shortest_edge: self.shortest_edge.min(other.shortest_edge),
            collapsed_edges: self.collapsed_edges + other.collapsed_edges,
        }
    }
}

impl Resolution {
    /// Returns a warning if edges collapsed.
    pub fn warning(&self) -> Option<Problem> {
        let what = self.path.display().to_string();
        warning(&self.place, &what, self.detail.ulp, self.detail.collapsed_edges)
    }
}

/// A mesh whose edges may have collapsed. They have not been examined.
#[derive(Debug)]
pub struct CollapseSuspect {
    /// Place in the scene file where the path of the mesh is written, for messages.
    pub place: String,
    /// Path of the mesh file.
    pub path: PathBuf,
    /// The ulp at the farthest coordinate, as in [`Resolution`].
    pub ulp: f64,
}

impl CollapseSuspect {
    /// Counts the collapsed edges of the placed mesh. Returns a warning if there are any.
    pub fn settle(&self, mesh: &TriangleMesh) -> Option<Problem> {
        let vertices = mesh.vertices();
        let collapsed = collapsed_edges(mesh, |i| vertices[i as usize]);
        warning(&self.place, &self.path.display().to_string(), self.ulp, collapsed)
    }

    /// Does the same for an instance of the mesh.
    pub fn settle_instance(&self, mesh: &TriangleMesh, placement: &Placement) -> Option<Problem> {
        let vertices = mesh.vertices();
        let collapsed = collapsed_edges(mesh, |i| placement.place(vertices[i as usize]));
        let what = format!("an instance of {}", self.path.display());
        warning(&self.place, &what, self.ulp, collapsed)
    }
}

/// A warning about `collapsed` edges of `what`; `None` if there are none.
fn warning(place: &str, what: &str, ulp: f64, collapsed: u64) -> Option<Problem> {
    let message = format!(
        "collapsed edges of {what}: {collapsed}. Their ends differ in the file, but are one point in \
         single precision around the scene's origin, where the step between numbers is up to {ulp:.2e}",
    );
    let help = "bring the shapes of the scene closer together, or render them apart";
    (collapsed > 0).then(|| Problem::new(place, message).help(help))
}

/// Returns the number of edges whose ends are the same point, with the vertices that `placed`
/// returns. In a mesh from a file, such an edge had two different ends: the reader drops triangles
/// with two equal corners.
fn collapsed_edges(mesh: &TriangleMesh, placed: impl Fn(u32) -> [f32; 3] + Sync) -> u64 {
    let in_chunk = |triangles: &[[u32; 3]]| {
        let mut found = Vec::new();
        for &[a, b, c] in triangles {
            let [p, q, r] = [a, b, c].map(&placed);
            if (p == q) | (q == r) | (r == p) {
                let sides = [(p == q, a, b), (q == r, b, c), (r == p, c, a)];
                let lost = sides.into_iter().filter(|side| side.0);
                found.extend(lost.map(|(_, i, j)| [i.min(j), i.max(j)]));
            }
        }
        found
    };
    count_once(parallel::map(mesh.triangles().chunks(GRAIN), in_chunk).concat())
}

/// Returns the number of different edges: triangles share them.
fn count_once(mut edges: Vec<[u32; 2]>) -> u64 {
    edges.par_sort_unstable();
    edges.dedup();
    edges.len() as u64
}

struct Edges {
    shortest_squared: f64,
    collapsed: Vec<[u32; 2]>,
}

impl Default for Edges {
    fn default() -> Self {
        Self { shortest_squared: f64::INFINITY, collapsed: Vec::new() }
    }
}

impl Edges {
    /// Records the squared length of an edge. An edge of length 0 in the file does not count.
    fn see(&mut self, squared: f64) {
        if squared > 0.0 && squared < self.shortest_squared {
            self.shortest_squared = squared;
        }
    }

    fn with(mut self, mut other: Self) -> Self {
        self.see(other.shortest_squared);
        self.collapsed.append(&mut other.collapsed);
        self
    }
}

/// Returns the distance from |x|, rounded to f32, to the next larger f32.
pub fn ulp(x: f64) -> f64 {
    let x = (x.abs() as f32).max(f32::MIN_POSITIVE);
    f64::from(f32::from_bits(x.to_bits() + 1)) - f64::from(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ulps_of_known_numbers() {
        assert_eq!(ulp(1.0), f64::from(f32::EPSILON));
        assert_eq!(ulp(-500_000.0), 0.03125);
        assert_eq!(ulp(0.0), f64::from(f32::from_bits(1)));
    }

    #[test]
    fn shared_edges_count_once_and_only_where_the_ends_differ() {
        let at = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1e-3, 0.0], [0.0, 0.0, 0.0]];
        let exact = |i: u32| DVec3::from(at[i as usize]);
        // Rounded to quarters, vertex 2 falls onto vertex 1. Vertices 0 and 3 are the same point
        // from the start.
        let coarse = |p: DVec3| ((p * 4.0).round() / 4.0).as_vec3().to_array();
        let triangles = [[0, 1, 2], [2, 1, 3], [0, 1, 3]];
        let found = Detail::new(0.0, &triangles, 2.0, exact, coarse);
        assert_eq!((found.shortest_edge, found.collapsed_edges), (2e-3, 1));
        let seen = at.map(|p| coarse(p.into()));
        let mesh = TriangleMesh::new(seen.to_vec(), triangles.to_vec(), false);
        assert_eq!(collapsed_edges(&mesh, |i| seen[i as usize]), 2, "all that have no length");
        let fine = |p: DVec3| p.as_vec3().to_array();
        let found = Detail::new(0.0, &triangles, 1.0, exact, fine);
        assert_eq!((found.shortest_edge, found.collapsed_edges), (1e-3, 0));
    }
}
