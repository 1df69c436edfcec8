//! Stitches: triangles without area that close T-junctions. A stitch lies between a long edge and
//! the points on it that only the other side uses.
//!
//! Rounding moves these points off the edge: once when the mesh is placed, and again when a test
//! takes corners relative to a ray. The stitch has the same rounded corners, so it fills the gap
//! and the mesh stays closed. It is only as wide as the rounding, so its normal is meaningless. A
//! hit on a stitch counts as a hit of the triangle beside it.

use glam::DVec3;

use super::doubles::doubles;
use super::mesh::TriangleMesh;
use super::primitives::Geometry;
use super::triangle::clamp_barycentrics;
use crate::mesh::kept_stitches;
use crate::ray::{LANES, Mask, RayPacket, lane};

impl TriangleMesh {
    /// Appends the `candidates` that lie along an edge of a triangle of the mesh. Their indices
    /// must be below the number of vertices.
    #[must_use]
    pub fn with_stitches(mut self, candidates: &[[u32; 3]]) -> Self {
        if candidates.is_empty() {
            return self;
        }
        let position = |v: u32| doubles(self.vertices[v as usize]);
        let kept = kept_stitches(candidates, &self.triangles, self.vertices.len(), position);
        self.triangles.reserve_exact(kept.len());
        self.triangles.extend(kept.iter().map(|(stitch, _)| stitch));
        self.stitches = kept.into_iter().map(|(_, beside)| beside).collect();
        self.runs.take();
        self
    }

    /// Number of stitches: the last triangles of the mesh.
    pub fn stitches(&self) -> usize {
        self.stitches.len()
    }

    /// Triangle beside stitch `prim`; `None` for any other triangle.
    #[inline]
    fn beside_stitch(&self, prim: u32) -> Option<u32> {
        let first = self.triangles.len() - self.stitches.len();
        let stitch = (prim as usize).checked_sub(first)?;
        self.stitches.get(stitch).copied()
    }
}

impl Geometry {
    /// Moves hits on stitches to the triangles beside them, which are no farther away than the
    /// rounding of coordinates. Call it before [`super::refine`]; it costs nothing in a scene
    /// without stitches.
    #[inline(always)]
    pub fn replace_stitch_hits(&self, hit: &Mask, packet: &mut RayPacket) {
        if self.stitched {
            self.move_beside(hit, packet);
        }
    }

    #[inline(never)]
    fn move_beside(&self, hit: &Mask, packet: &mut RayPacket) {
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let geom = packet.hits.geom[i];
            let Some((mesh, _)) = self.mesh(geom) else { continue };
            let Some(prim) = mesh.beside_stitch(packet.hits.prim[i]) else { continue };
            let Some((corners, _)) = self.triangles(geom, prim).next() else { continue };
            let t = f64::from(packet.rays.tfar[i]);
            let point =
                lane(&packet.rays.org, i).as_dvec3() + lane(&packet.rays.dir, i).as_dvec3() * t;
            let (u, v) = weights(point, corners);
            packet.hits.prim[i] = prim;
            (packet.hits.u[i], packet.hits.v[i]) = (u as f32, v as f32);
        }
    }
}

/// Barycentric weights of the second and third corner, at the projection of `point` onto the
/// triangle.
fn weights(point: DVec3, [a, b, c]: [DVec3; 3]) -> (f64, f64) {
    let (e1, e2, p) = (b - a, c - a, point - a);
    let normal = e1.cross(e2);
    let area = normal.dot(normal);
    clamp_barycentrics(p.cross(e2).dot(normal) / area, e1.cross(p).dot(normal) / area)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle with the legs 4 and 8 and a corner at (1, 2, 3), beside a smaller one. The first
    /// two stitches lie along its first leg, one behind the other. The third lies alone.
    fn stitched() -> TriangleMesh {
        let at = |x: f32, y: f32| [1.0 + x, 2.0 + y, 3.0];
        let corners = vec![at(0.0, 0.0), at(4.0, 0.0), at(0.0, 8.0), at(-1.0, 0.0)];
        let between = [at(1.0, 0.0), at(3.0, 0.0), at(20.0, 0.0), at(21.0, 0.0), at(22.0, 0.0)];
        let vertices = [corners, between.to_vec()].concat();
        let mesh = TriangleMesh::new(vertices, vec![[2, 0, 3], [0, 1, 2]], false);
        mesh.with_stitches(&[[0, 4, 5], [0, 5, 1], [6, 7, 8]])
    }

    #[test]
    fn stitches_along_a_triangle_are_kept() {
        let mesh = stitched();
        assert_eq!(mesh.triangles(), [[2, 0, 3], [0, 1, 2], [0, 4, 5], [0, 5, 1]]);
        let beside = [0, 1, 2, 3, 4].map(|prim| mesh.beside_stitch(prim));
        assert_eq!(beside, [None, None, Some(1), Some(1), None]);
    }

    #[test]
    fn only_hits_on_stitches_are_moved() {
        let mesh = stitched();
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
        let mut packet = RayPacket::EMPTY;
        for (i, prim) in [(2, 3), (3, 1), (4, 3)] {
            // The ray meets the plane at (2, 3, 3).
            packet.rays.set(i, glam::Vec3::new(1.0, 5.0, -1.0), glam::Vec3::new(0.25, -0.5, 1.0));
            (packet.hits.geom[i], packet.hits.prim[i], packet.rays.tfar[i]) = (0, prim, 4.0);
        }
        let mut hit = Mask::ALL;
        hit.0[4] = 0;
        let before = packet.clone();
        geometry.replace_stitch_hits(&packet.hit(&hit), &mut packet);
        assert_eq!((packet.hits.prim[2], packet.hits.u[2], packet.hits.v[2]), (1, 0.25, 0.125));
        for i in [3, 4] {
            let point = |p: &RayPacket| (p.hits.prim[i], p.hits.u[i], p.hits.v[i]);
            assert_eq!(point(&packet), point(&before));
        }
    }

    #[test]
    fn weights_are_those_of_the_projection() {
        let corners =
            [DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 3.5), DVec3::new(1.5, 5.0, 2.0)];
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        for (u, v) in [(0.25, 0.5), (0.625, 0.125)] {
            let (p, q) = weights(a * (1.0 - u - v) + b * u + c * v + normal * 0.1, corners);
            assert!((p - u).abs() < 1e-12 && (q - v).abs() < 1e-12, "{p} {q}");
        }
    }
}
