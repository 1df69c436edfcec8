//! The faces around each vertex of a mesh.
//!
//! Every task owns a range of vertices and reads the triangles in file order. So it needs no
//! atomics, and the result is the same for any number of threads. Neighbouring triangles in a file
//! usually have neighbouring vertices, so a task skips most blocks of triangles.

use std::ops::{Range, RangeInclusive};

use crate::parallel;

/// Number of triangles in a block. The range of vertices is stored for each block.
const BLOCK: usize = 1 << 14;

/// A table of the faces around each vertex. Triangles that repeat a vertex are left out.
pub(super) struct VertexFaces {
    /// End of each vertex's faces in `faces`. They begin where the previous vertex's faces end.
    ends: Vec<usize>,
    /// Indices of triangles; ascending for each vertex.
    faces: Vec<u32>,
}

impl VertexFaces {
    /// Size in bytes.
    pub(super) fn bytes(&self) -> u64 {
        (size_of_val(&self.ends[..]) + size_of_val(&self.faces[..])) as u64
    }

    /// Builds the table: 12 bytes per triangle and 8 per vertex. There must be fewer than 2^32
    /// triangles.
    ///
    /// # Panics
    /// If a triangle has an index that is not below `vertices`.
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let blocks = Blocks::new(triangles);
        let beyond = blocks.ranges.iter().find(|range| *range.end() as usize >= vertices);
        assert!(beyond.is_none() || triangles.is_empty(), "{beyond:?} of {vertices} vertices");
        let mut ends = vec![0usize; vertices];
        let share = vertices.div_ceil(rayon::current_num_threads()).max(1);
        let counts = parallel::map(ends.chunks_mut(share).enumerate(), |(task, counts)| {
            blocks.each_corner(task * share, counts.len(), |_, vertex, is_own| {
                counts[vertex] += usize::from(is_own);
            });
            counts.iter().sum::<usize>()
        });
        let mut faces = vec![0u32; counts.iter().sum()];
        let (mut tasks, mut start, mut rest) = (Vec::new(), 0, &mut faces[..]);
        for (task, (ends, count)) in ends.chunks_mut(share).zip(counts).enumerate() {
            let (own, behind) = rest.split_at_mut(count);
            tasks.push((task * share, start, ends, own));
            (start, rest) = (start + count, behind);
        }
        parallel::each(tasks.into_iter(), |(first, start, ends, own)| {
            // Each count becomes the start of the vertex's faces. Filling moves it to their end.
            let mut next = 0;
            for end in &mut *ends {
                next += std::mem::replace(end, next);
            }
            if let Some(last) = own.len().checked_sub(1) {
                blocks.each_corner(first, ends.len(), |face, vertex, is_own| {
                    let place = &mut own[ends[vertex].min(last)];
                    *place = if is_own { face } else { *place };
                    ends[vertex] += usize::from(is_own);
                });
            }
            ends.iter_mut().for_each(|end| *end += start);
        });
        Self { ends, faces }
    }

    /// Returns the faces of one vertex, in file order and without repeats.
    #[inline(always)]
    pub(super) fn of(&self, vertex: usize) -> &[u32] {
        self.of_all(vertex..vertex + 1)
    }

    /// Returns the faces of consecutive vertices, one vertex after the other.
    #[inline(always)]
    pub(super) fn of_all(&self, vertices: Range<usize>) -> &[u32] {
        &self.faces[self.start(vertices.start)..self.start(vertices.end)]
    }

    /// Returns entry `place` of the table, which lists the faces of one vertex after the other.
    /// Returns the last entry if `place` is beyond it. The table must not be empty.
    #[inline(always)]
    pub(super) fn at(&self, place: usize) -> usize {
        self.faces[place.min(self.faces.len() - 1)] as usize
    }

    /// Returns the end of the shortest run of vertices, from the start of `vertices` on, that has
    /// at least `corners` faces. Returns the end of `vertices` if all of them have fewer.
    pub(super) fn run(&self, vertices: Range<usize>, corners: usize) -> usize {
        let enough = self.start(vertices.start) + corners;
        let ends = &self.ends[vertices.clone()];
        vertices.end.min(vertices.start + 1 + ends.iter().take_while(|&&end| end < enough).count())
    }

    /// Returns the place of a vertex's first face in the table.
    #[inline(always)]
    pub(super) fn start(&self, vertex: usize) -> usize {
        if vertex == 0 { 0 } else { self.ends[vertex - 1] }
    }
}

/// Triangles in blocks of at most [`BLOCK`] consecutive ones.
struct Blocks<'a> {
    triangles: &'a [[u32; 3]],
    /// The range of vertices of each block.
    ranges: Vec<RangeInclusive<u32>>,
}

impl<'a> Blocks<'a> {
    fn new(triangles: &'a [[u32; 3]]) -> Self {
        let range = |block: &[[u32; 3]]| {
            let (mut low, mut high) = (u32::MAX, 0);
            for &vertex in block.as_flattened() {
                (low, high) = (low.min(vertex), high.max(vertex));
            }
            low..=high
        };
        Self { triangles, ranges: parallel::map(triangles.chunks(BLOCK), range) }
    }

    /// Calls `visit` for each corner of the triangles in all blocks that overlap the `count` > 0
    /// vertices from `first` on. Leaves out triangles that repeat a vertex.
    ///
    /// The arguments are the index of the triangle, the vertex relative to `first`, and whether it
    /// is one of the `count` vertices. Any other vertex appears as the last of them. So `visit`
    /// needs no branch, which would be mispredicted where a file has no order.
    #[inline(always)]
    fn each_corner(&self, first: usize, count: usize, mut visit: impl FnMut(u32, usize, bool)) {
        for (block, range) in self.ranges.iter().enumerate() {
            if (*range.end() as usize) < first || *range.start() as usize >= first + count {
                continue;
            }
            let from = block * BLOCK;
            let triangles = &self.triangles[from..self.triangles.len().min(from + BLOCK)];
            for (face, &[a, b, c]) in (from as u32..).zip(triangles) {
                if a == b || b == c || c == a {
                    continue;
                }
                for vertex in [a, b, c] {
                    let vertex = (vertex as usize).wrapping_sub(first);
                    visit(face, vertex.min(count - 1), vertex < count);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_vertex_has_its_faces_in_file_order_for_any_number_of_threads() {
        let mut seed = 1u64;
        let mut random = move |below: u32| {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as u32 % below
        };
        for (vertices, count) in [(1, 0), (3, 20), (50, 400), (4000, 60_000)] {
            let triangles: Vec<[u32; 3]> =
                (0..count).map(|_| [0; 3].map(|_| random(vertices))).collect();
            let mut expected = vec![Vec::new(); vertices as usize];
            for (face, &[a, b, c]) in (0..).zip(&triangles) {
                if a != b && b != c && c != a {
                    [a, b, c].iter().for_each(|&v| expected[v as usize].push(face));
                }
            }
            for threads in [1, 2, 7] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let found = pool.install(|| VertexFaces::new(vertices as usize, &triangles));
                for (vertex, expected) in expected.iter().enumerate() {
                    assert_eq!(found.of(vertex), expected, "{threads} threads");
                }
            }
        }
    }

    /// The faces end where they began for the last vertices, of which a whole task has none.
    #[test]
    fn vertices_without_a_face_have_none() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let found = pool.install(|| VertexFaces::new(100, &[[0, 1, 2]]));
        assert_eq!((found.of(2), found.of_all(3..100)), (&[0][..], &[][..]));
    }

    #[test]
    #[should_panic(expected = "of 3 vertices")]
    fn an_index_beyond_the_vertices_panics() {
        VertexFaces::new(3, &[[0, 1, 3]]);
    }
}
