//! Edges that lie on each other at the stitches of T-junctions. For creases they are one edge.

use super::normals::VertexPosition;
use crate::error::Result;
use crate::math::{dot, sub};
use crate::reserve;

/// For each stitch and each of its two far vertices: this vertex, and the other two vertices of the
/// stitch. At it, the edges to the other two lie on each other. Sorted.
pub(super) struct StitchedEdges(Vec<[u32; 3]>);

impl StitchedEdges {
    /// Finds the edges of all stitches. `name` is the mesh's name for messages.
    ///
    /// # Errors
    /// `Retry` if there is no memory.
    pub(super) fn new<P: VertexPosition>(
        positions: &[P],
        stitches: &[[u32; 3]],
        name: &str,
    ) -> Result<Self> {
        let mut all = Vec::new();
        reserve::exact(&mut all, 2 * stitches.len(), name)?;
        for &[a, b, c] in stitches {
            for [vertex, u, v] in [[a, b, c], [b, c, a], [c, a, b]] {
                let [p, to, and] = [vertex, u, v].map(|k| positions[k as usize].xyz());
                // Negative at the middle vertex.
                if dot(sub(to, p), sub(and, p)) > 0.0 {
                    all.push([vertex, u, v]);
                }
            }
        }
        all.sort_unstable();
        Ok(Self(all))
    }

    /// Returns the entries of a vertex.
    pub(super) fn at(&self, vertex: u32) -> &[[u32; 3]] {
        let rest = &self.0[self.0.partition_point(|entry| entry[0] < vertex)..];
        &rest[..rest.partition_point(|entry| entry[0] == vertex)]
    }
}

/// Gives edges that lie on each other the same end. `edges` are those at one vertex: the vertex at
/// their other end, and anything. `stitched` are the vertex's entries.
pub(super) fn join<T>(stitched: &[[u32; 3]], edges: &mut [(u32, T)]) {
    let mut ends: Vec<u32> = stitched.iter().flat_map(|&[_, u, v]| [u, v]).collect();
    ends.sort_unstable();
    ends.dedup();
    let mut group: Vec<usize> = (0..ends.len()).collect();
    for &[_, u, v] in stitched {
        if let (Ok(u), Ok(v)) = (ends.binary_search(&u), ends.binary_search(&v)) {
            let (u, v) = (first(&mut group, u), first(&mut group, v));
            group[u.max(v)] = u.min(v);
        }
    }
    for (other, _) in edges {
        if let Ok(end) = ends.binary_search(other) {
            *other = ends[first(&mut group, end)];
        }
    }
}

/// Returns the first member of a group. Shortens the path to it (union-find).
pub(super) fn first(group: &mut [usize], mut place: usize) -> usize {
    while group[place] != place {
        group[place] = group[group[place]];
        place = group[place];
    }
    place
}
