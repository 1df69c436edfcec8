//! Rejects hits behind the flat primitive that a ray leaves.

use glam::DVec3;

use super::doubles::doubles;
use super::primitives::{Geometry, GeometryKind};
use super::quad::quad_halves;
use crate::ray::NONE;

impl Geometry {
    /// Whether a triangle lies behind the tangent plane of the primitive that a ray leaves, or in
    /// it up to rounding. No valid hit lies there, but a test in f32 may report one: the
    /// other face of a convex edge, for instance. Returns false for a ray that starts on the other
    /// side of the plane or runs along it. A quad need not be flat, so the triangle must lie behind
    /// the planes of both halves. Points are relative to [`Geometry::origin`].
    pub fn is_behind_leaving(
        &self,
        leaving: u32,
        origin: DVec3,
        direction: DVec3,
        corners: [DVec3; 3],
    ) -> bool {
        if leaving == NONE {
            return false;
        }
        let (geom, prim) = self.place(leaving);
        let behind = |plane| is_behind(plane, origin, direction, corners);
        match self.kind(geom) {
            GeometryKind::Mesh(mesh) => behind(self.meshes[mesh].corners(prim)),
            GeometryKind::Quads => quad_halves(self.quads[prim as usize]).into_iter().all(behind),
            GeometryKind::Instance(index) => behind(self.instance_corners(index, prim)),
            GeometryKind::Spheres => false,
        }
    }
}

/// [`Geometry::is_behind_leaving`] for one plane through three points. The tolerance is one ulp of
/// the largest coordinate.
fn is_behind(plane: [[f32; 3]; 3], origin: DVec3, direction: DVec3, corners: [DVec3; 3]) -> bool {
    let [a, b, c] = plane.map(doubles);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let facing = normal.dot(direction.normalize_or_zero());
    if facing.abs() < f64::from(f32::EPSILON) {
        return false;
    }
    let above = |v: DVec3| normal.dot(v - a) * facing.signum();
    let all = [a, b, c].into_iter().chain(corners);
    let largest = all.fold(0.0, |most, v| v.abs().max_element().max(most));
    let ulp = f64::from(f32::EPSILON) * largest;
    above(origin) >= -ulp && corners.into_iter().all(|corner| above(corner) <= ulp)
}

#[cfg(test)]
mod tests {
    use super::super::mesh::TriangleMesh;
    use super::*;

    /// A roof: the second triangle slopes down from the first along the y axis.
    fn roof() -> (Geometry, [DVec3; 3]) {
        let vertices = vec![[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, -0.5]];
        let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2], [0, 1, 3]], false);
        let other = [DVec3::ZERO, DVec3::Y, DVec3::new(1.0, 0.0, -0.5)];
        (Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap(), other)
    }

    #[test]
    fn only_triangles_behind_the_plane_are_rejected() {
        let (roof, other) = roof();
        let origin = DVec3::new(-1e-8, 0.5, 1e-9);
        let behind =
            |leaving, origin, direction| roof.is_behind_leaving(leaving, origin, direction, other);
        assert!(behind(0, origin, DVec3::new(1.0, 0.0, 0.01)));
        // Downwards the ray may hit the other side of the roof: it is in front then.
        assert!(!behind(0, -origin, DVec3::new(1.0, 0.0, -0.01)));
        // The ray leaves no primitive, or runs along the plane.
        assert!(!behind(NONE, origin, DVec3::new(1.0, 0.0, 0.01)));
        assert!(!behind(0, origin, DVec3::X));
        // The ray starts behind the plane.
        assert!(!behind(0, origin - DVec3::Z, DVec3::new(1.0, 0.0, 0.01)));
        // One corner rises above the plane.
        let rises = [other[0], other[1], DVec3::new(1.0, 0.0, 1e-6)];
        assert!(!roof.is_behind_leaving(0, origin, DVec3::new(1.0, 0.0, 0.01), rises));
    }

    #[test]
    fn a_quad_rejects_only_behind_both_planes() {
        // The third corner is bent up, so the plane of the second half lies below the first half.
        let quad = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 1e-3], [0.0, 1.0, 0.0]];
        let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![]).unwrap();
        let behind = |z: f64| {
            let corners = [[0.2, 0.2], [0.2, 0.3], [0.3, 0.2]].map(|[x, y]| DVec3::new(x, y, z));
            geometry.is_behind_leaving(0, DVec3::new(0.7, 0.7, 4.1e-4), DVec3::Z, corners)
        };
        // Behind both planes, and between them.
        assert!(behind(-1e-3));
        assert!(!behind(-3e-4));
    }

    #[test]
    fn the_tolerance_is_an_ulp_of_the_largest_coordinate() {
        let plane = [[0.0; 3], [64.0, 0.0, 0.0], [0.0, 64.0, 0.0]];
        let ulp = 64.0 * f64::from(f32::EPSILON);
        let behind = |origin: f64, corner: f64, up: f64| {
            let corners = [[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]];
            let corners = corners.map(|[x, y]| DVec3::new(x, y, corner * ulp));
            is_behind(plane, DVec3::new(1.0, 1.0, origin * ulp), DVec3::new(1.0, 0.0, up), corners)
        };
        for up in [1e-3, 1.0] {
            assert!(behind(-0.9, 0.9, up) && behind(0.9, -0.9, -up));
            assert!(!behind(-1.1, 0.9, up) && !behind(-0.9, 1.1, up));
            assert!(!behind(1.1, -0.9, -up) && !behind(0.9, -1.1, -up));
        }
    }
}
