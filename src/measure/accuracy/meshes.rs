//! Closed meshes and soups that are made, not read.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::measure::random::Random;

/// Vertices around the origin and triangles over them.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    /// Positions in f64, not rounded to f32.
    pub vertices: Vec<DVec3>,
    /// Indices into `vertices`, three for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// From every point of a box around the origin, this fraction of the mesh's own, all vertices are in sight.
    pub core: f64,
}

/// [`Shape::core`] of a shape without spikes.
const CORE: f64 = 0.3;

/// Vertices that are looked up by their coordinates.
#[derive(Default)]
struct Welded {
    vertices: Vec<DVec3>,
    known: HashMap<[u64; 3], u32>,
}

impl Welded {
    fn index(&mut self, v: DVec3) -> u32 {
        let next = self.vertices.len() as u32;
        // Adding 0 makes -0 and 0 the same.
        let index = *self.known.entry(v.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next);
        if index == next {
            self.vertices.push(v);
        }
        index
    }
}

/// A sphere of radius 1: 20 * 4^levels triangles.
pub fn icosphere(levels: usize) -> Shape {
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
    // Edges of the icosahedron are its shortest distances.
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
    Shape { vertices: vertices.vertices, triangles, core: CORE }
}

/// A cube from -1 to 1 whose sides have 2 n^2 triangles each.
pub fn cube(n: u32) -> Shape {
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
    Shape { vertices: vertices.vertices, triangles, core: CORE }
}

/// 27 cells that share their walls, from -1 to 1: every inner edge has four walls, so the mesh is not a
/// manifold. `all` of it, or the walls of the middle cell alone, over the same vertices.
pub fn cells(all: bool) -> Shape {
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
    Shape { vertices: vertices.vertices, triangles, core: CORE }
}

/// A ball of radius 1/3 whose faces are spikes of length 2/3: 20 * 4^levels tips of three thin triangles each, all of
/// which have the tip first.
pub fn spiky_ball(levels: usize) -> Shape {
    let Shape { mut vertices, triangles, .. } = icosphere(levels);
    let mut spikes = Vec::with_capacity(3 * triangles.len());
    for [a, b, c] in triangles {
        let sum: DVec3 = [a, b, c].map(|v| vertices[v as usize]).iter().sum();
        let tip = vertices.len() as u32;
        vertices.push(sum.normalize() * 3.0);
        spikes.extend([[tip, a, b], [tip, b, c], [tip, c, a]]);
    }
    vertices.iter_mut().for_each(|v| *v /= 3.0);
    Shape { vertices, triangles: spikes, core: 0.01 }
}

/// What a closed scan looks like: 20,480 triangles of uneven size over folds and noise; its middle
/// sees all of it.
pub fn scan() -> Shape {
    let mut shape = icosphere(5);
    let mut random = Random::new(0x5ca4, 0);
    for v in &mut shape.vertices {
        let p = *v;
        let folds = 0.22 * (3.0 * p.x + 1.0).sin() * (2.0 * p.y).cos()
            + 0.12 * (7.0 * p.z + 2.0 * p.x).sin()
            + 0.03 * (23.0 * p.y - 11.0 * p.x).sin();
        // Sideways by less than half an edge, outwards by a scanner's noise.
        let sideways = random.direction() * 0.008;
        *v = (p + sideways).normalize() * (1.0 + folds + random.within(-4e-4, 4e-4));
    }
    shape
}

impl Shape {
    /// Each coordinate times a factor.
    #[must_use]
    pub fn squashed(mut self, by: DVec3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v *= by);
        self
    }

    /// Every edge has a triangle on either side.
    pub fn is_closed(&self) -> bool {
        let mut edges: HashMap<[u32; 2], u32> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry([p.min(q), p.max(q)]).or_default() += 1;
            }
        }
        edges.values().all(|&n| n == 2)
    }

    /// The shape times `scale` around `center`, rounded to f32.
    pub fn placed(&self, center: DVec3, scale: f64) -> TriangleMesh {
        let vertices = self.vertices.iter().map(|&v| (center + v * scale).as_vec3().to_array());
        TriangleMesh::new(vertices.collect(), self.triangles.clone(), false)
    }
}

/// One mesh as a scene.
pub fn scene(mesh: TriangleMesh) -> Geometry {
    geometry(vec![mesh], vec![], vec![])
}

/// Triangles that share no vertex.
pub fn soup(triangles: &[[DVec3; 3]]) -> TriangleMesh {
    let vertices = triangles.iter().flatten().map(|v| v.as_vec3().to_array()).collect();
    let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    TriangleMesh::new(vertices, indices, false)
}

/// A scene of few primitives.
pub fn geometry(
    meshes: Vec<TriangleMesh>,
    quads: Vec<[[f32; 3]; 4]>,
    spheres: Vec<Sphere>,
) -> Geometry {
    Geometry::new(DVec3::ZERO, meshes, quads, spheres).unwrap_or_default()
}

/// Corners of a triangle in f64.
pub fn corners(mesh: &TriangleMesh, triangle: u32) -> [DVec3; 3] {
    mesh.corners(triangle).map(|v| Vec3::from(v).as_dvec3())
}

/// A point within a triangle, evenly distributed.
pub fn inside(random: &mut Random, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (u, v) = (random.unit().sqrt(), random.unit());
    a * (1.0 - u) + b * (u * (1.0 - v)) + c * (u * v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_meshes_are_closed_and_of_the_size_they_say() {
        for (shape, triangles) in
            [(icosphere(3), 1280), (cube(8), 768), (scan(), 20480), (spiky_ball(3), 3840)]
        {
            assert!(shape.is_closed());
            assert_eq!(shape.triangles.len(), triangles);
            // Of a sphere's kind: V - E + F = 2.
            assert_eq!(shape.vertices.len(), triangles / 2 + 2);
        }
        // Of 54 inner and 54 outer walls.
        assert!(cells(false).is_closed() && !cells(true).is_closed());
        assert_eq!((cells(true).triangles.len(), cells(true).vertices.len()), (216, 64));
    }
}
