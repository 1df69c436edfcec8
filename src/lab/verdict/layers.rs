//! Finds the layers of surface that a ray certainly hits, however rounding moves the corners.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::accel::brute::{Near, Outline};

/// A layer of surface that the ray certainly hits: the range of its t, widened by the errors of t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceLayer {
    /// Smallest t of the layer.
    pub near: f64,
    /// Largest t of the layer.
    pub far: f64,
}

impl SurfaceLayer {
    fn of<'a>(parts: impl Iterator<Item = &'a Near>) -> Self {
        let none = Self { near: f64::INFINITY, far: f64::NEG_INFINITY };
        parts.fold(none, |layer, part| Self {
            near: layer.near.min(part.t - part.t_error),
            far: layer.far.max(part.t + part.t_error),
        })
    }
}

/// Bits of the coordinates of an edge's corners, sorted so that both triangles get the same key.
type Edge = [[u64; 3]; 2];

/// Returns the layers that a watertight test certainly hits, although each sheared corner may move
/// by its error bound.
///
/// Triangles that share edges form a patch, and their shared corners move together. The rim of a
/// patch consists of the edges that belong to an odd number of its triangles.
///
/// Suppose that no edge of the rim can reach the ray, and that the rim winds around the ray an odd
/// number of times. Both stay true after any move. The number of triangles that contain the ray
/// equals the winding number of the rim modulo 2. So at least one triangle contains the ray, and
/// the patch is a layer. At a silhouette both triangles of an edge lie on the same side of the ray.
/// Then the number is even, and the patch is no layer.
pub fn layers(near: &[Near]) -> Vec<SurfaceLayer> {
    let sure = near.iter().filter(|part| match &part.outline {
        Outline::Sphere(sure) => *sure,
        // A triangle that contains the ray beyond the error bound of its edges is a layer by
        // itself.
        outline => Triangle::of(outline).is_some_and(|triangle| triangle.holds(outline)),
    });
    let mut layers: Vec<SurfaceLayer> =
        sure.map(|part| SurfaceLayer::of([part].into_iter())).collect();
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
            layers.push(SurfaceLayer::of(patch.iter().map(|(part, _)| *part)));
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
        // Adding 0 turns -0 into 0.
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

/// Groups triangles that are connected by shared edges. Copies of one triangle count once.
fn patches(near: &[Near]) -> Vec<Vec<(&Near, Triangle<'_>)>> {
    let mut triangles: Vec<(&Near, Triangle)> =
        near.iter().filter_map(|part| Some((part, Triangle::of(&part.outline)?))).collect();
    triangles.sort_by_key(|(_, triangle)| triangle.edges());
    triangles.dedup_by_key(|(_, triangle)| triangle.edges());
    // Disjoint sets: triangle i is in the set of triangle `parent[i]`.
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

/// Returns whether closed polygons wind around the origin an odd number of times.
///
/// Counts the crossings of edges with the positive x axis. No edge may pass through the origin.
fn goes_round(edges: impl Iterator<Item = [DVec2; 2]>) -> bool {
    let crosses = |[p, q]: [DVec2; 2]| {
        (p.y > 0.0) != (q.y > 0.0) && {
            // `side` is x at y = 0, times (q.y - p.y).
            let side = p.perp_dot(q);
            if q.y > p.y { side > 0.0 } else { side < 0.0 }
        }
    };
    edges.filter(|&edge| crosses(edge)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::BuildOptions;
    use crate::accel::brute::Brute;
    use crate::accel::lane::LaneRay;
    use crate::geometry::{Geometry, NONE, TriangleMesh};
    use crate::monitor::Monitor;

    /// Number of layers and of near triangles for a ray down the z axis at (x, y).
    fn seen(vertices: &[[f32; 3]], triangles: &[[u32; 3]], x: f32, y: f32) -> (usize, usize) {
        let mesh = TriangleMesh::new(vertices.to_vec(), triangles.to_vec(), false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
        let options = BuildOptions { threads: 1, max_bytes: None };
        let oracle = Brute::build(&geometry, &options, &Monitor::default()).unwrap();
        let ray = LaneRay {
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
    fn a_fan_is_a_layer_at_its_middle_and_along_its_edges() {
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 0.5), (2, 1));
        assert_eq!(seen(&SQUARE, &FAN, 0.5, 0.5), (1, 2));
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 0.0), (1, 4));
        assert_eq!(seen(&SQUARE, &FAN, 1e-7, 3e-8), (1, 4));
        // Neither winding nor copies make a difference.
        assert_eq!(seen(&SQUARE, &[[0, 2, 1], [0, 2, 3], [0, 3, 4], [0, 1, 4]], 0.0, 0.0), (1, 4));
        assert_eq!(seen(&SQUARE, &[FAN[0], FAN[1], FAN[2], FAN[3], [1, 2, 0]], 0.0, 0.0), (1, 5));
    }

    #[test]
    fn rims_gaps_and_folds_are_no_layers() {
        // A ray at the rim of the square.
        assert_eq!(seen(&SQUARE, &FAN, 0.0, 1.0), (0, 1));
        assert_eq!(seen(&SQUARE, &FAN, 1.0, 1.0), (0, 2));
        // One triangle of the fan is missing.
        assert_eq!(seen(&SQUARE, &FAN[..3], 0.0, 0.0), (0, 3));
        // A ray at the silhouette of a roof's ridge: both sides lie below y = 0.
        let roof = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, -1.0], [0.0, -1.5, -2.0]];
        let sides = [[0, 1, 2], [1, 0, 3]];
        assert_eq!(seen(&roof, &sides, 0.0, 0.0), (0, 2));
        // A ray through both sides: each is a layer, and the patch, which is even, is none.
        assert_eq!(seen(&roof, &sides, 0.0, -0.5), (2, 2));
        // A ray far beside it passes nothing.
        assert_eq!(seen(&roof, &sides, 0.0, 0.5), (0, 0));
    }
}
