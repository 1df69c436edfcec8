//! Smooth vertex normals for meshes without normals of their own.
//!
//! The normal of a vertex is the normalised sum over its faces of area x corner angle x face
//! normal. Each vertex adds its faces in file order, in f64. So the result has the same bits for
//! any number of threads and every instruction set.

use std::ops::Range;

use super::vertex_faces::VertexFaces;
use crate::math::{self, cross, dot, sub};
use crate::parallel;
use crate::simd::{self, Isa, Kernel, prefetch};

/// A vertex position in single or double precision.
pub trait VertexPosition: Copy + Send + Sync {
    /// Returns the coordinates, converted to `f64` exactly.
    fn xyz(self) -> [f64; 3];
}

impl VertexPosition for [f32; 3] {
    #[inline(always)]
    fn xyz(self) -> [f64; 3] {
        self.map(f64::from)
    }
}

impl VertexPosition for [f64; 3] {
    #[inline(always)]
    fn xyz(self) -> [f64; 3] {
        self
    }
}

/// Number of vertices that one task handles.
pub(super) const CHUNK: usize = 1024;

/// Returns one unit normal per vertex, in the space of `positions`. The normal is `[0, 0, 0]` for a
/// vertex without faces, and where the faces cancel out.
///
/// Runs in the caller's rayon pool. It needs 8 bytes of temporary memory per vertex, 12 per
/// triangle, and 88 per face of the vertex with the most faces.
///
/// # Panics
/// If a triangle has an index beyond `positions`.
pub fn vertex_normals<P: VertexPosition>(positions: &[P], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    // A scene cannot hold so many triangles, so their normals do not matter.
    if triangles.len() > u32::MAX as usize {
        return vec![[0.0; 3]; positions.len()];
    }
    let faces = VertexFaces::new(positions.len(), triangles);
    let mut normals = vec![[0.0f32; 3]; positions.len()];
    parallel::each(normals.chunks_mut(CHUNK).enumerate(), |(chunk, normals)| {
        let mut batch = CornerBatch::default();
        let vertices = chunk * CHUNK..chunk * CHUNK + normals.len();
        batch.each_vertex((positions, triangles), &faces, vertices.clone(), |vertex, fan| {
            normals[vertex - vertices.start] = unit(fan.sum(0..fan.len()));
        });
    });
    normals
}

/// Returns the edges that leave a triangle's corner at `vertex`: to the next corner and to the
/// previous one.
#[inline(always)]
fn edges<P: VertexPosition>(positions: &[P], [a, b, c]: [u32; 3], vertex: u32) -> [[f64; 3]; 2] {
    // Selects, because a branch would be mispredicted for every second corner.
    let (is_a, is_b) = (vertex == a, vertex == b);
    let next = if is_a { b } else { c };
    let next = if is_a || is_b { next } else { a };
    let last = if is_b { a } else { b };
    let last = if is_a { c } else { last };
    let corner = positions[vertex as usize].xyz();
    [next, last].map(|end| sub(positions[end as usize].xyz(), corner))
}

/// Returns twice area x normal of the face between two edges, the length of this vector, and the
/// angle between the edges in [0, pi].
#[inline(always)]
fn corner(to_next: [f64; 3], to_last: [f64; 3]) -> ([f64; 3], f64, f64) {
    let normal = cross(to_next, to_last);
    // Unlike the arc cosine, the arc tangent is accurate for needles too.
    let length = dot(normal, normal).sqrt();
    (normal, length, math::angle(length, dot(to_next, to_last)))
}

/// Number of corners after which a batch is full. A batch holds all corners of its vertices, so it
/// may have more.
const BATCH: usize = 128;

/// The triangle that is this many corners ahead is prefetched.
const PREFETCH_DISTANCE: usize = 64;

/// Corners of the faces around some vertices. Structure of arrays: the values of all corners are
/// computed by one SIMD loop.
#[derive(Default)]
pub(super) struct CornerBatch {
    /// Both edges that leave each corner.
    edges: [Vec<f64>; 6],
    /// Twice area x normal of each corner's face.
    normals: [Vec<f64>; 3],
    /// Length of each of these vectors.
    lengths: Vec<f64>,
    /// Angle of each corner.
    angles: Vec<f64>,
}

/// The corners of all faces around one vertex, in file order.
pub(super) struct Fan<'b> {
    batch: &'b CornerBatch,
    corners: Range<usize>,
}

impl CornerBatch {
    /// Calls `visit` with the index of each of `vertices` and its corners, in ascending order.
    pub(super) fn each_vertex<P: VertexPosition>(
        &mut self,
        (positions, triangles): (&[P], &[[u32; 3]]),
        faces: &VertexFaces,
        vertices: Range<usize>,
        mut visit: impl FnMut(usize, Fan),
    ) {
        let isa = Isa::detect();
        let mut first = vertices.start;
        while first < vertices.end {
            let last = faces.run(first..vertices.end, BATCH);
            let mesh = (positions, triangles);
            simd::dispatch(isa, FillCorners { batch: self, mesh, faces, vertices: first..last });
            let mut start = 0;
            for vertex in first..last {
                let end = start + faces.of(vertex).len();
                visit(vertex, Fan { batch: self, corners: start..end });
                start = end;
            }
            first = last;
        }
    }
}

/// Root of the smallest normal number, rounded up.
const MIN_LENGTH: f64 = 1.5e-154;

/// Computes the corners of some vertices.
struct FillCorners<'a, P> {
    batch: &'a mut CornerBatch,
    mesh: (&'a [P], &'a [[u32; 3]]),
    faces: &'a VertexFaces,
    vertices: Range<usize>,
}

impl<P: VertexPosition> Kernel for FillCorners<'_, P> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { batch, mesh: (positions, triangles), faces, vertices } = self;
        let n = faces.of_all(vertices.clone()).len();
        if batch.angles.len() < n {
            batch.resize(n);
        }
        let CornerBatch { edges: [ax, ay, az, bx, by, bz], normals: [x, y, z], .. } = batch;
        // Slices of one length: the loops need no bounds checks.
        let (ax, ay, az) = (&mut ax[..n], &mut ay[..n], &mut az[..n]);
        let (bx, by, bz) = (&mut bx[..n], &mut by[..n], &mut bz[..n]);
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        let (lengths, angles) = (&mut batch.lengths[..n], &mut batch.angles[..n]);
        let (first, mut i) = (faces.start(vertices.start), 0);
        for vertex in vertices {
            for &face in faces.of(vertex) {
                prefetch(triangles, faces.at(first + i + PREFETCH_DISTANCE));
                let ends = edges(positions, triangles[face as usize], vertex as u32);
                // Always true: it removes the bounds checks.
                if i < n {
                    [[ax[i], ay[i], az[i]], [bx[i], by[i], bz[i]]] = ends;
                }
                i += 1;
            }
        }
        for i in 0..n {
            let (normal, length, angle) = corner([ax[i], ay[i], az[i]], [bx[i], by[i], bz[i]]);
            [x[i], y[i], z[i]] = normal;
            (lengths[i], angles[i]) = (length, angle);
        }
    }
}

impl CornerBatch {
    fn resize(&mut self, corners: usize) {
        let all = self.edges.iter_mut().chain(&mut self.normals);
        for values in all.chain([&mut self.lengths, &mut self.angles]) {
            values.resize(corners, 0.0);
        }
    }
}

impl Fan<'_> {
    /// Returns the number of faces.
    pub(super) fn len(&self) -> usize {
        self.corners.len()
    }

    /// Returns the sum of area x angle x normal of some faces, times two. `faces` are positions in
    /// the fan.
    #[inline]
    pub(super) fn sum(&self, faces: impl Iterator<Item = usize>) -> [f64; 3] {
        let CornerBatch { normals, angles, .. } = self.batch;
        let mut sum = [0.0; 3];
        for i in faces.map(|face| self.corners.start + face) {
            for axis in 0..3 {
                sum[axis] += angles[i] * normals[axis][i];
            }
        }
        sum
    }

    /// Returns twice area x normal of each face.
    pub(super) fn normals(&self) -> impl Iterator<Item = [f64; 3]> {
        let CornerBatch { normals: [x, y, z], .. } = self.batch;
        self.corners.clone().map(move |i| [x[i], y[i], z[i]])
    }

    /// Returns true if all faces have an area, and a normal whose cosine to `normal` is at least
    /// `min_cosine`.
    #[inline]
    pub(super) fn is_within(&self, normal: [f32; 3], min_cosine: f64) -> bool {
        let normal = normal.map(f64::from);
        let CornerBatch { normals: [x, y, z], lengths, .. } = self.batch;
        self.corners.clone().all(|i| {
            // The square of a smaller length has lost bits.
            lengths[i] > MIN_LENGTH && dot([x[i], y[i], z[i]], normal) >= min_cosine * lengths[i]
        })
    }
}

/// Returns `sum` at unit length, or zero if it is zero or not finite. It is divided by its largest
/// component first, because squares of tiny or huge components would leave the range.
pub(super) fn unit(sum: [f64; 3]) -> [f32; 3] {
    let largest = sum.iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    // A NaN component makes the length NaN, and NaN is not > 0.
    let scaled = sum.map(|c| c / largest);
    let length = dot(scaled, scaled).sqrt();
    if length > 0.0 && length.is_finite() { scaled.map(|c| (c / length) as f32) } else { [0.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes the normals of [`vertex_normals`] serially, without the table of faces.
    fn one_by_one<P: VertexPosition>(positions: &[P], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
        let mut sums = vec![[0.0; 3]; positions.len()];
        for &triangle in triangles {
            let [a, b, c] = triangle;
            for vertex in [a, b, c] {
                add_face(&mut sums[vertex as usize], positions, triangle, vertex);
            }
        }
        sums.into_iter().map(unit).collect()
    }

    /// Adds area x angle x normal of `triangle` at its corner `vertex`, times two.
    fn add_face<P: VertexPosition>(
        sum: &mut [f64; 3],
        positions: &[P],
        triangle: [u32; 3],
        vertex: u32,
    ) {
        let [a, b, c] = triangle;
        if a == b || b == c || c == a {
            return;
        }
        let [to_next, to_last] = edges(positions, triangle, vertex);
        let (normal, _, angle) = corner(to_next, to_last);
        for (sum, normal) in sum.iter_mut().zip(normal) {
            *sum += angle * normal;
        }
    }

    fn grid(n: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for y in 0..n {
            for x in 0..n {
                let (fx, fy) = (x as f32 * 0.1, y as f32 * 0.13);
                positions.push([fx, fy, (fx * 3.0).sin() * (fy * 2.0).cos()]);
                if x + 1 < n && y + 1 < n {
                    let a = y * n + x;
                    triangles.push([a, a + 1, a + n + 1]);
                    triangles.push([a, a + n + 1, a + n]);
                }
            }
        }
        (positions, triangles)
    }

    #[test]
    fn vertex_normals_have_the_same_bits_for_any_number_of_threads() {
        let (positions, triangles) = grid(120);
        let expected = one_by_one(&positions, &triangles);
        for threads in [1, 2, 3, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| vertex_normals(&positions, &triangles));
            assert_eq!(found, expected, "{threads} threads");
        }
        let double: Vec<[f64; 3]> = positions.iter().map(|p| p.xyz()).collect();
        assert_eq!(vertex_normals(&double, &triangles), expected);
    }

    #[test]
    fn the_normal_at_a_cube_corner_does_not_depend_on_how_its_squares_are_split() {
        // Three unit squares at the origin. They are split so that the corner has one or two
        // triangles.
        let p: [[f32; 3]; 7] = [
            [0., 0., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 1., 0.],
            [0., 1., 1.],
            [1., 0., 1.],
        ];
        // With area weights alone, or angle weights alone, the split would skew the normal.
        let t = [[0, 2, 4], [0, 4, 1], [0, 3, 5], [0, 5, 2], [0, 1, 6], [0, 6, 3]];
        let n = vertex_normals(&p, &t)[0];
        let d = -(1.0f32 / 3.0).sqrt();
        for c in n {
            assert!((c - d).abs() < 1e-6, "{n:?}");
        }
    }

    #[test]
    fn weights_are_area_times_angle() {
        // The face along x has twice the area and a right angle. The face along z has 45 degrees.
        let p: [[f64; 3]; 5] =
            [[0., 0., 0.], [0., 2., 0.], [0., 0., 1.], [1., 0., 0.], [1., 1., 0.]];
        let n = vertex_normals(&p, &[[0, 1, 2], [0, 3, 4]])[0];
        // The sum is 1 * pi/2 along x and 0.5 * pi/4 along z.
        assert!((n[0] / n[2] - 4.0).abs() < 1e-6, "{n:?}");
        assert_eq!(n[1], 0.0);
    }

    #[test]
    fn unused_vertices_degenerate_faces_and_extreme_scales() {
        let p = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [9., 9., 9.]];
        let n = vertex_normals(&p, &[[0, 1, 2], [0, 0, 1], [0, 1, 1]]);
        assert_eq!(n, [[0., 0., 1.], [0., 0., 1.], [0., 0., 1.], [0., 0., 0.]]);
        for scale in [1e-70, 1e-20, 1e20, 1e70] {
            let scaled: Vec<[f64; 3]> = p.iter().map(|p| p.map(|c: f64| c * scale)).collect();
            assert_eq!(vertex_normals(&scaled, &[[0, 1, 2]])[0], [0., 0., 1.], "{scale}");
        }
        // Two faces back to back cancel out.
        assert_eq!(vertex_normals(&p, &[[0, 1, 2], [0, 2, 1]])[0], [0.0; 3]);
        assert!(vertex_normals::<[f32; 3]>(&[], &[]).is_empty());
    }
}
