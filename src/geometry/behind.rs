//! What a ray that leaves a flat primitive cannot meet.

use glam::DVec3;

use super::{Geometry, GeometryKind, NONE};

impl Geometry {
    /// Whether a triangle stands behind the plane of the primitive that a ray leaves, or on it for all that f32 can
    /// tell, where the ray does not go: the other side of a convex edge from which it starts, say. A test in f32 may meet
    /// it there. Not so of a ray that starts on the other side of that plane, or runs along it. A quad has the planes
    /// of both its halves, as it need not be quite flat. Points are relative to [`Geometry::origin`].
    pub fn is_left_behind(
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
            GeometryKind::Quads => {
                let [v0, v1, v2, v3] = self.quads[prim as usize];
                behind([v0, v1, v3]) && behind([v2, v3, v1])
            }
            GeometryKind::Spheres => false,
        }
    }
}

/// The same of the plane through three points: an ulp of the largest coordinate is what f32 cannot tell.
fn is_behind(plane: [[f32; 3]; 3], origin: DVec3, direction: DVec3, corners: [DVec3; 3]) -> bool {
    let [a, b, c] = plane.map(|v| DVec3::from(v.map(f64::from)));
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
    use super::super::TriangleMesh;
    use super::*;

    /// A roof: the second triangle falls away from the first along the y axis.
    fn roof() -> (Geometry, [DVec3; 3]) {
        let vertices = vec![[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, -0.5]];
        let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2], [0, 1, 3]], false);
        let other = [DVec3::ZERO, DVec3::Y, DVec3::new(1.0, 0.0, -0.5)];
        (Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap(), other)
    }

    #[test]
    fn only_what_is_behind_is_left_behind() {
        let (roof, other) = roof();
        let origin = DVec3::new(-1e-8, 0.5, 1e-9);
        let behind =
            |leaving, origin, direction| roof.is_left_behind(leaving, origin, direction, other);
        assert!(behind(0, origin, DVec3::new(1.0, 0.0, 0.01)));
        // Downwards, the other side of the roof may be met: then it is in front.
        assert!(!behind(0, -origin, DVec3::new(1.0, 0.0, -0.01)));
        // It leaves nothing, or runs along the plane.
        assert!(!behind(NONE, origin, DVec3::new(1.0, 0.0, 0.01)));
        assert!(!behind(0, origin, DVec3::X));
        // It comes from behind the plane.
        assert!(!behind(0, origin - DVec3::Z, DVec3::new(1.0, 0.0, 0.01)));
        // A corner that rises.
        let rises = [other[0], other[1], DVec3::new(1.0, 0.0, 1e-6)];
        assert!(!roof.is_left_behind(0, origin, DVec3::new(1.0, 0.0, 0.01), rises));
    }

    #[test]
    fn a_quad_has_two_planes() {
        // Its third corner is bent up, so the plane of its second half lies under the first half.
        let quad = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 1e-3], [0.0, 1.0, 0.0]];
        let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![]).unwrap();
        let behind = |z: f64| {
            let corners = [[0.2, 0.2], [0.2, 0.3], [0.3, 0.2]].map(|[x, y]| DVec3::new(x, y, z));
            geometry.is_left_behind(0, DVec3::new(0.7, 0.7, 4.1e-4), DVec3::Z, corners)
        };
        // Under both, and between them.
        assert!(behind(-1e-3));
        assert!(!behind(-3e-4));
    }
}
