//! Smooth vertex normals for meshes without normals of their own.
//!
//! The normal of a vertex is the normalised sum over its faces of area x corner angle x face
//! normal. Each vertex adds its faces in file order, in f64. So the result has the same bits for
//! any number of threads.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

/// A vertex position in single or double precision.
pub trait Point: Copy + Send + Sync {
    /// Returns the coordinates, converted to `f64` exactly.
    fn xyz(self) -> [f64; 3];
}

impl Point for [f32; 3] {
    #[inline(always)]
    fn xyz(self) -> [f64; 3] {
        self.map(f64::from)
    }
}

impl Point for [f64; 3] {
    #[inline(always)]
    fn xyz(self) -> [f64; 3] {
        self
    }
}

#[inline(always)]
pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A table of the faces around each vertex.
pub(super) struct VertexFaces {
    /// The faces of vertex v are `faces[starts[v]..starts[v + 1]]`, in any order.
    starts: Vec<usize>,
    faces: Vec<AtomicU32>,
}

impl VertexFaces {
    /// Builds the table: 12 bytes per triangle and 8 per vertex. Panics if a triangle has an index
    /// beyond `vertices`.
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let counts: Vec<AtomicU32> =
            (0..vertices).into_par_iter().map(|_| AtomicU32::new(0)).collect();
        each_corner(triangles, |_, vertex| {
            counts[vertex].fetch_add(1, Relaxed);
        });
        let mut starts = Vec::with_capacity(vertices + 1);
        let mut total = 0usize;
        for count in &counts {
            starts.push(total);
            total += count.load(Relaxed) as usize;
        }
        starts.push(total);
        let faces: Vec<AtomicU32> = (0..total).into_par_iter().map(|_| AtomicU32::new(0)).collect();
        each_corner(triangles, |face, vertex| {
            let left = counts[vertex].fetch_sub(1, Relaxed) as usize;
            faces[starts[vertex + 1] - left].store(face, Relaxed);
        });
        Self { starts, faces }
    }

    /// Writes the faces of one vertex to `sorted`, in file order and without repeats.
    pub(super) fn of(&self, vertex: usize, sorted: &mut Vec<u32>) {
        sorted.clear();
        let faces = &self.faces[self.starts[vertex]..self.starts[vertex + 1]];
        sorted.extend(faces.iter().map(|face| face.load(Relaxed)));
        // The threads stored them in arbitrary order.
        sorted.sort_unstable();
        sorted.dedup();
    }
}

/// Returns one unit normal per vertex, in the space of `positions`. The normal is `[0, 0, 0]` for a
/// vertex without faces, and where the faces cancel out.
///
/// Runs in the caller's rayon pool. It needs 12 bytes of temporary memory per triangle. Panics if a
/// triangle has an index beyond `positions`.
pub fn vertex_normals<P: Point>(positions: &[P], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    if triangles.len() > u32::MAX as usize {
        return one_by_one(positions, triangles);
    }
    let faces = VertexFaces::new(positions.len(), triangles);
    (0..positions.len())
        .into_par_iter()
        .with_min_len(1024)
        .map_with(Vec::new(), |sorted, vertex| {
            faces.of(vertex, sorted);
            let mut sum = [0.0; 3];
            for &face in sorted.iter() {
                add_face(&mut sum, positions, triangles[face as usize], vertex as u32);
            }
            unit(sum)
        })
        .collect()
}

fn each_corner(triangles: &[[u32; 3]], visit: impl Fn(u32, usize) + Sync) {
    triangles.par_iter().with_min_len(4096).enumerate().for_each(|(face, triangle)| {
        for &vertex in triangle {
            visit(face as u32, vertex as usize);
        }
    });
}

/// Computes the same normals serially, without the table of faces. For meshes with more triangles
/// than the table can number, and as the reference in tests.
fn one_by_one<P: Point>(positions: &[P], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![[0.0; 3]; positions.len()];
    for &triangle in triangles {
        let [a, b, c] = triangle;
        for vertex in [a, b, c] {
            add_face(&mut sums[vertex as usize], positions, triangle, vertex);
        }
    }
    sums.into_iter().map(unit).collect()
}

/// A face as its corner sees it: twice area x normal, and the length of this vector.
pub(super) type FaceNormal = ([f64; 3], f64);

/// Adds the contribution of `triangle` to the normal at its corner `vertex`. The factor two of the
/// returned vector is the same for all faces.
#[inline]
pub(super) fn add_face<P: Point>(
    sum: &mut [f64; 3],
    positions: &[P],
    triangle: [u32; 3],
    vertex: u32,
) -> FaceNormal {
    let [a, b, c] = triangle;
    if a == b || b == c || c == a {
        return ([0.0; 3], 0.0);
    }
    // Rotated so that the corner comes first: same face, same orientation.
    let (next, last) = if vertex == a {
        (b, c)
    } else if vertex == b {
        (c, a)
    } else {
        (a, b)
    };
    let corner = positions[vertex as usize].xyz();
    let to_next = sub(positions[next as usize].xyz(), corner);
    let to_last = sub(positions[last as usize].xyz(), corner);
    let normal = cross(to_next, to_last);
    // Unlike the arc cosine, the arc tangent is accurate for needles too.
    let length = dot(normal, normal).sqrt();
    let angle = length.atan2(dot(to_next, to_last));
    for (sum, normal) in sum.iter_mut().zip(normal) {
        *sum += angle * normal;
    }
    (normal, length)
}

/// Returns the vector `sum` at unit length, or zero if it has no direction. It is divided by its
/// largest component first, because squares of tiny or huge components would leave the range.
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
