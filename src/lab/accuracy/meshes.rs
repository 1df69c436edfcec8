//! Generated closed meshes and triangle soups.

use std::collections::HashMap;

use glam::DVec3;

use crate::geometry::{Geometry, Sphere, TriangleMesh, doubles};
use crate::lab::random::Random;

/// A generated mesh around the origin, in f64.
#[derive(Debug, Clone, Default)]
pub struct TestMesh {
    /// Positions in f64, not rounded to f32.
    pub vertices: Vec<DVec3>,
    /// Indices into `vertices`, three for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Size of a box around the origin, as a fraction of the mesh's own box. The whole mesh is
    /// visible from every point of that box.
    pub core: f64,
}

/// [`TestMesh::core`] of a shape without spikes.
const CORE: f64 = 0.3;

/// Shared vertices, found by their coordinates.
#[derive(Default)]
struct Welded {
    vertices: Vec<DVec3>,
    known: HashMap<[u64; 3], u32>,
}

impl Welded {
    fn index(&mut self, v: DVec3) -> u32 {
        let next = self.vertices.len() as u32;
        // Adding 0 turns -0 into 0.
        let index = *self.known.entry(v.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next);
        if index == next {
            self.vertices.push(v);
        }
        index
    }
}

/// A sphere of radius 1 with 20 * 4^levels triangles.
pub fn icosphere(levels: usize) -> TestMesh {
    let mut vertices = Welded::default();
    let phi = (1.0 + 5f64.sqrt()) / 2.0;
    let mut faces: Vec<[DVec3; 3]> = Vec::new();
    let corners: Vec<DVec3> = (0..3)
        .flat_map(|axis| {
            [(1.0, phi), (1.0, -phi), (-1.0, phi), (-1.0, -phi)].map(|(a, b)| {
                let mut v = [0.0; 3];
                (v[axis], v[(axis + 1) % 3]) = (a, b);
                DVec3::from(v).normalize()
            })
        })
        .collect();
    // The edges of the icosahedron are the shortest distances between its corners.
    let edge = 2.0 / (phi * phi + 1.0).sqrt() * 1.01;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let near = |i: usize, j: usize| corners[i].distance(corners[j]) < edge;
                if near(a, b) && near(b, c) && near(a, c) {
                    faces.push([corners[a], corners[b], corners[c]]);
                }
            }
        }
    }
    for _ in 0..levels {
        let half = |p: DVec3, q: DVec3| (p + q).normalize();
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (half(a, b), half(b, c), half(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let triangles = faces.iter().map(|face| face.map(|v| vertices.index(v))).collect();
    TestMesh { vertices: vertices.vertices, triangles, core: CORE }
}

/// A cube from -1 to 1 whose sides have 2 n^2 triangles each.
pub fn cube(n: u32) -> TestMesh {
    let mut vertices = Welded::default();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for end in [-1.0, 1.0] {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(di, dj)| {
                    let mut v = [end; 3];
                    v[(axis + 1) % 3] = f64::from(i + di) / f64::from(n) * 2.0 - 1.0;
                    v[(axis + 2) % 3] = f64::from(j + dj) / f64::from(n) * 2.0 - 1.0;
                    vertices.index(DVec3::from(v))
                });
                triangles.extend(if (i + j) % 2 == 0 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [b, c, d]]
                });
            }
        }
    }
    TestMesh { vertices: vertices.vertices, triangles, core: CORE }
}

/// 27 cells from -1 to 1 that share their walls. Four walls share every inner edge, so the mesh is
/// not a manifold.
///
/// Without `all` the mesh has only the walls of the middle cell, over the same vertices.
pub fn cells(all: bool) -> TestMesh {
    let mut vertices = Welded::default();
    let mut triangles = Vec::new();
    let at = |k: u32| f64::from(k) / 1.5 - 1.0;
    for (axis, end) in (0..3).flat_map(|axis| (0..4).map(move |end| (axis, end))) {
        for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(di, dj)| {
                let mut v = [at(end); 3];
                (v[(axis + 1) % 3], v[(axis + 2) % 3]) = (at(i + di), at(j + dj));
                vertices.index(DVec3::from(v))
            });
            let is_middle = (end == 1 || end == 2) && i == 1 && j == 1;
            if all || is_middle {
                let [a, b, c, d] = corners;
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    TestMesh { vertices: vertices.vertices, triangles, core: CORE }
}

/// A ball of radius 1/3 with a spike of length 2/3 on each of its 20 * 4^levels faces.
///
/// A spike consists of three thin triangles whose first vertex is the tip.
pub fn spiky_ball(levels: usize) -> TestMesh {
    let TestMesh { mut vertices, triangles, .. } = icosphere(levels);
    let mut spikes = Vec::with_capacity(3 * triangles.len());
    for [a, b, c] in triangles {
        let sum: DVec3 = [a, b, c].map(|v| vertices[v as usize]).iter().sum();
        let tip = vertices.len() as u32;
        vertices.push(sum.normalize() * 3.0);
        spikes.extend([[tip, a, b], [tip, b, c], [tip, c, a]]);
    }
    vertices.iter_mut().for_each(|v| *v /= 3.0);
    TestMesh { vertices, triangles: spikes, core: 0.01 }
}

/// A closed mesh like a scan: 20,480 triangles of uneven size with folds and noise. The whole mesh
/// is visible from its middle.
pub fn scan() -> TestMesh {
    let mut shape = icosphere(5);
    let mut random = Random::new(0x5ca4, 0);
    for v in &mut shape.vertices {
        let p = *v;
        let folds = 0.22 * (3.0 * p.x + 1.0).sin() * (2.0 * p.y).cos()
            + 0.12 * (7.0 * p.z + 2.0 * p.x).sin()
            + 0.03 * (23.0 * p.y - 11.0 * p.x).sin();
        // Move the vertex sideways by less than half an edge. Along the radius it gets the folds
        // and a scanner's noise.
        let sideways = random.direction() * 0.008;
        *v = (p + sideways).normalize() * (1.0 + folds + random.within(-4e-4, 4e-4));
    }
    shape
}

impl TestMesh {
    /// Multiplies each coordinate by a factor.
    #[must_use]
    pub fn squashed(mut self, by: DVec3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v *= by);
        self
    }

    /// Returns whether every edge belongs to two triangles.
    pub fn is_closed(&self) -> bool {
        let mut edges: HashMap<[u32; 2], u32> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry([p.min(q), p.max(q)]).or_default() += 1;
            }
        }
        edges.values().all(|&n| n == 2)
    }

    /// The mesh, scaled by `scale` and moved to `center`, rounded to f32.
    pub fn placed(&self, center: DVec3, scale: f64) -> TriangleMesh {
        let vertices = self.vertices.iter().map(|&v| (center + v * scale).as_vec3().to_array());
        TriangleMesh::new(vertices.collect(), self.triangles.clone(), false)
    }
}

/// A geometry of one mesh.
pub fn scene(mesh: TriangleMesh) -> Geometry {
    geometry(vec![mesh], vec![], vec![])
}

/// A mesh of triangles that share no vertex.
pub fn soup(triangles: &[[DVec3; 3]]) -> TriangleMesh {
    let vertices = triangles.iter().flatten().map(|v| v.as_vec3().to_array()).collect();
    let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh::new(vertices, indices, false)
}

/// A geometry with its origin at 0. It is empty if there are more primitives than indices.
pub fn geometry(
    meshes: Vec<TriangleMesh>,
    quads: Vec<[[f32; 3]; 4]>,
    spheres: Vec<Sphere>,
) -> Geometry {
    Geometry::new(DVec3::ZERO, meshes, quads, spheres).unwrap_or_default()
}

/// Corners of the triangle with index `triangle`, in f64.
pub fn corners(mesh: &TriangleMesh, triangle: u32) -> [DVec3; 3] {
    mesh.corners(triangle).map(doubles)
}

/// Corners of a random triangle of a mesh.
pub fn any_triangle(random: &mut Random, mesh: &TriangleMesh) -> [DVec3; 3] {
    corners(mesh, random.below(mesh.triangles().len() as u32))
}

/// A uniformly distributed point in a triangle.
pub fn inside(random: &mut Random, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (u, v) = (random.unit().sqrt(), random.unit());
    a * (1.0 - u) + b * (u * (1.0 - v)) + c * (u * v)
}

/// A point of a triangle: its first corner (0), a random point of its first edge (1), or a random
/// point inside (any other number).
pub fn point_on(random: &mut Random, [a, b, c]: [DVec3; 3], which: u32) -> DVec3 {
    match which {
        0 => a,
        1 => a.lerp(b, random.unit()),
        _ => inside(random, [a, b, c]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generated_meshes_are_closed_and_have_the_documented_size() {
        for (shape, triangles) in
            [(icosphere(3), 1280), (cube(8), 768), (scan(), 20480), (spiky_ball(3), 3840)]
        {
            assert!(shape.is_closed());
            assert_eq!(shape.triangles.len(), triangles);
            // Euler's formula for the topology of a sphere: V - E + F = 2.
            assert_eq!(shape.vertices.len(), triangles / 2 + 2);
        }
        // 54 inner and 54 outer walls of two triangles each.
        assert!(cells(false).is_closed() && !cells(true).is_closed());
        assert_eq!((cells(true).triangles.len(), cells(true).vertices.len()), (216, 64));
    }
}
