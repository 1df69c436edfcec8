//! What a ray cannot pass: the layers that stay in its way however the corners move.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::accel::brute::{Near, Outline};

/// Where a layer lies on the ray, errors of t included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Smallest t of the layer.
    pub near: f64,
    /// Largest t of the layer.
    pub far: f64,
}

impl Layer {
    fn of<'a>(parts: impl Iterator<Item = &'a Near>) -> Self {
        let none = Self { near: f64::INFINITY, far: f64::NEG_INFINITY };
        parts.fold(none, |layer, part| Self {
            near: layer.near.min(part.t - part.t_error),
            far: layer.far.max(part.t + part.t_error),
        })
    }
}

/// An edge between two corners, in an order that does not depend on the triangle.
type Edge = [[u64; 3]; 2];

/// The layers that a watertight test meets for certain, although each sheared corner may have moved
/// by its bound.
///
/// Triangles that share edges move together. Their rim is what is left of their edges when those
/// that two of them share are taken away. If no part of the rim can reach the ray, and the rim goes
/// round the ray an odd number of times, then so it does after any move, and at least one of the
/// triangles holds the ray (its number of layers there is odd, modulo 2 it is the winding number
/// of the rim). At a silhouette both triangles of an edge lie on the same side, two layers or
/// none: even.
pub fn layers(near: &[Near]) -> Vec<Layer> {
    let sure = near.iter().filter(|part| match &part.outline {
        Outline::Sphere(sure) => *sure,
        // One triangle that holds the ray well inside, whatever it shares.
        outline => Triangle::of(outline).is_some_and(|triangle| triangle.holds(outline)),
    });
    let mut layers: Vec<Layer> = sure.map(|part| Layer::of([part].into_iter())).collect();
    for patch in patches(near) {
        let mut rim: BTreeMap<Edge, (bool, f64, [DVec2; 2])> = BTreeMap::new();
        for &(part, triangle) in &patch {
            for i in 0..3 {
                let clearance = part.outline.clearance(i);
                let entry = rim.entry(triangle.edge(i)).or_insert((
                    false,
                    clearance,
                    [triangle.sheared[i], triangle.sheared[(i + 1) % 3]],
                ));
                entry.0 = !entry.0;
                entry.1 = entry.1.min(clearance);
            }
        }
        rim.retain(|_, (odd, ..)| *odd);
        let clear = rim.values().all(|&(_, clearance, _)| clearance > 0.0);
        if clear && goes_round(rim.values().map(|&(.., ends)| ends)) {
            layers.push(Layer::of(patch.iter().map(|(part, _)| *part)));
        }
    }
    layers
}

#[derive(Clone, Copy)]
struct Triangle<'a> {
    corners: &'a [DVec3; 3],
    sheared: &'a [DVec2; 3],
}

impl<'a> Triangle<'a> {
    fn of(outline: &'a Outline) -> Option<Self> {
        match outline {
            Outline::Triangle { corners, sheared, .. } => Some(Self { corners, sheared }),
            Outline::Sphere(_) => None,
        }
    }

    fn holds(&self, outline: &Outline) -> bool {
        let edges = (0..3).map(|i| [self.sheared[i], self.sheared[(i + 1) % 3]]);
        (0..3).all(|i| outline.clearance(i) > 0.0) && goes_round(edges)
    }

    fn edge(&self, i: usize) -> Edge {
        // Adding 0 makes -0 and 0 the same corner.
        let key = |v: DVec3| v.to_array().map(|x| (x + 0.0).to_bits());
        let mut edge = [key(self.corners[i]), key(self.corners[(i + 1) % 3])];
        edge.sort_unstable();
        edge
    }

    fn edges(&self) -> [Edge; 3] {
        let mut edges = [0, 1, 2].map(|i| self.edge(i));
        edges.sort_unstable();
        edges
    }
}

/// The triangles, those that are connected by edges together, copies of the same triangle once.
fn patches(near: &[Near]) -> Vec<Vec<(&Near, Triangle<'_>)>> {
    let mut triangles: Vec<(&Near, Triangle)> =
        near.iter().filter_map(|part| Some((part, Triangle::of(&part.outline)?))).collect();
    triangles.sort_by_key(|(_, triangle)| triangle.edges());
    triangles.dedup_by_key(|(_, triangle)| triangle.edges());
    // Disjoint sets: triangle i belongs with triangle `parent[i]`.
    let mut parent: Vec<usize> = (0..triangles.len()).collect();
    let mut owners: BTreeMap<Edge, usize> = BTreeMap::new();
    for (i, (_, triangle)) in triangles.iter().enumerate() {
        for edge in triangle.edges() {
            let other = *owners.entry(edge).or_insert(i);
            let (a, b) = (root(&mut parent, i), root(&mut parent, other));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut patches: BTreeMap<usize, Vec<(&Near, Triangle)>> = BTreeMap::new();
    for (i, triangle) in triangles.into_iter().enumerate() {
        patches.entry(root(&mut parent, i)).or_default().push(triangle);
    }
    patches.into_values().collect()
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

/// Whether closed polygons go round the origin an odd number of times: crossings with the positive
/// x axis. None of the edges comes near the origin.
fn goes_round(edges: impl Iterator<Item = [DVec2; 2]>) -> bool {
    let crosses = |[p, q]: [DVec2; 2]| {
        (p.y > 0.0) != (q.y > 0.0) && {
            // Where y = 0, times a positive number: the sign of x.
            let side = p.perp_dot(q);
            if q.y > p.y { side > 0.0 } else { side < 0.0 }
        }
    };
    edges.filter(|&edge| crosses(edge)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::brute::Brute;
    use crate::accel::{BuildOptions, lane::Ray};
    use crate::geometry::{Geometry, NONE, TriangleMesh};
    use crate::monitor::Monitor;

    /// Layers and the number of near triangles for a ray down the z axis at (x, y).
    fn seen(vertices: &[[f32; 3]], triangles: &[[u32; 3]], x: f32, y: f32) -> (usize, usize) {
        let mesh = TriangleMesh::new(vertices.to_vec(), triangles.to_vec(), false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
        let options = BuildOptions { threads: 1, max_bytes: None };
        let oracle = Brute::build(&geometry, &options, &Monitor::default()).unwrap();
        let ray = Ray {
            origin: DVec3::new(x.into(), y.into(), 1.0),
            direction: DVec3::NEG_Z,
            tnear: 0.0,
            tfar: f64::INFINITY,
            leaving: NONE,
        };
        let near = oracle.near(&ray, 1.0, 1000).unwrap();
        (layers(&near).len(), near.len())
    }

    /// A square of side 2 around the origin, cut into four by its diagonals.
    const SQUARE: [[f32; 3]; 5] =
        [[0.0; 3], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]];
    const FAN: [[u32; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];

    #[test]
    fn a_fan_holds_at_its_middle_and_along_its_edges() {
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 0.5), (2, 1));
        assert_eq!(seen(&SQUARE, &FAN, 0.5, 0.5), (1, 2));
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 0.0), (1, 4));
        assert_eq!(seen(&SQUARE, &FAN, 1e-7, 3e-8), (1, 4));
        // Windings do not matter, copies neither.
        assert_eq!(seen(&SQUARE, &[[0, 2, 1], [0, 2, 3], [0, 3, 4], [0, 1, 4]], 0.0, 0.0), (1, 4));
        assert_eq!(seen(&SQUARE, &[FAN[0], FAN[1], FAN[2], FAN[3], [1, 2, 0]], 0.0, 0.0), (1, 5));
    }

    #[test]
    fn rims_gaps_and_folds_hold_nothing() {
        // The rim of the square.
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 1.0), (0, 1));
        assert_eq!(seen(&SQUARE, &FAN, 1.0, 1.0), (0, 2));
        // One triangle of the fan is missing.
        assert_eq!(seen(&SQUARE, &FAN[..3], 0.0, 0.0), (0, 3));
        // A roof seen along its ridge's silhouette: both sides lie below y = 0.
        let roof = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, -1.0], [0.0, -1.5, -2.0]];
        let sides = [[0, 1, 2], [1, 0, 3]];
        assert_eq!(seen(&roof, &sides, 0.0, 0.0), (0, 2));
        // In front of both: each by itself, together they are even.
        assert_eq!(seen(&roof, &sides, 0.0, -0.5), (2, 2));
        // Far beside it nothing is near.
        assert_eq!(seen(&roof, &sides, 0.0, 0.5), (0, 0));
    }
}
