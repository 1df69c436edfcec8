//! Instances: meshes that are placed in the scene several times and held once.
//!
//! The vertices of an instance are those of its mesh, transformed in f64 and rounded to f32. Every
//! reader computes them in the same way, so an instance has the same bits as a mesh with these
//! vertices.

use glam::{DMat3, DVec3};

use super::doubles::doubles;
use crate::math::{absolute, row_norm};

/// An affine map from the coordinates of a mesh to those of the scene, with its inverse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    linear: DMat3,
    offset: DVec3,
    inverse: DMat3,
    /// Transposed inverse of `linear`: it maps normals.
    normals: DMat3,
    /// Largest sum of magnitudes in a row of `inverse`.
    inverse_norm: f64,
}

impl Placement {
    /// The map `linear p + offset`. The [condition](crate::math::condition) of `linear` must be at
    /// most 1e6: with more, rounding would decide which leaves a ray reaches.
    pub fn new(linear: DMat3, offset: DVec3) -> Self {
        let inverse = linear.inverse();
        let normals = inverse.transpose();
        Self { linear, offset, inverse, normals, inverse_norm: row_norm(&inverse) }
    }

    /// Returns the position of a vertex in the scene.
    #[inline(always)]
    pub fn place(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.place_lanes([[x], [y], [z]]);
        [x[0], y[0], z[0]]
    }

    /// Returns the positions of several vertices, by axis and vertex. The bits are those of
    /// [`Placement::place`].
    #[inline(always)]
    pub fn place_lanes<const N: usize>(&self, vertices: [[f32; N]; 3]) -> [[f32; N]; 3] {
        let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = self.linear.to_cols_array_2d();
        let offset = self.offset;
        // Not a loop: the compiler would make vectors of axes instead of vertices.
        [
            place_axis([ax, bx, cx], offset.x, &vertices),
            place_axis([ay, by, cy], offset.y, &vertices),
            place_axis([az, bz, cz], offset.z, &vertices),
        ]
    }

    /// Returns the corners of a triangle in the scene.
    #[inline(always)]
    pub fn corners(&self, corners: [[f32; 3]; 3]) -> [[f32; 3]; 3] {
        [self.place(corners[0]), self.place(corners[1]), self.place(corners[2])]
    }

    /// Returns a normal in the scene, of unit length. It stays on its side of the surface, also if
    /// the map mirrors. Zero stays zero. A normal that is not finite becomes NaN.
    pub fn normal(&self, normal: [f32; 3]) -> [f32; 3] {
        let turned = self.normals * doubles(normal);
        turned.normalize_or(turned * 0.0).as_vec3().to_array()
    }

    /// Returns a point of the scene in the coordinates of the mesh.
    #[inline(always)]
    pub fn to_mesh(&self, point: DVec3) -> DVec3 {
        self.inverse * (point - self.offset)
    }

    /// Returns a vector of the scene in the coordinates of the mesh.
    #[inline(always)]
    pub fn vector_to_mesh(&self, vector: DVec3) -> DVec3 {
        self.inverse * vector
    }

    /// Returns the factor by which [`Placement::to_mesh`] enlarges an error: the largest coordinate
    /// of the result over the largest coordinate of the error.
    #[inline(always)]
    pub fn inverse_norm(&self) -> f64 {
        self.inverse_norm
    }

    /// Returns a box around the vertices that lie in a box of the mesh, both as lowest and highest
    /// coordinates.
    pub fn bounds(&self, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
        let center = self.linear * ((low + high) * 0.5) + self.offset;
        let half = absolute(&self.linear) * ((high - low) * 0.5);
        let size = absolute(&self.linear) * low.abs().max(high.abs()) + self.offset.abs();
        // Two ulp of f32 cover the rounding of the vertices.
        let half = half + DVec3::splat(size.max_element() * 2.0 * f64::from(f32::EPSILON));
        [center - half, center + half]
    }

    /// Returns a box of the mesh around everything whose place lies in a box of the scene.
    pub fn bounds_in_mesh(&self, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
        let center = self.to_mesh((low + high) * 0.5);
        let size = low.abs().max(high.abs()).max_element() + self.offset.abs().max_element();
        let slack = size * 2.0 * f64::from(f32::EPSILON);
        let half = absolute(&self.inverse) * ((high - low) * 0.5 + slack);
        [center - half, center + half]
    }
}

/// A mesh that several instances share, placed in the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// The mesh, as an index into [`Geometry::shared`](super::Geometry::shared).
    pub mesh: usize,
    /// From the coordinates of the mesh to those of the scene.
    pub placement: Placement,
    /// Lowest and highest coordinates of a box around all triangles, in the scene.
    pub bounds: [[f32; 3]; 2],
}

impl Instance {
    /// Places a mesh whose used vertices lie in the box from `low` to `high`.
    pub fn new(mesh: usize, placement: Placement, [low, high]: [DVec3; 2]) -> Self {
        // A conversion to f32 rounds by half an ulp; the box is two ulp wider than needed.
        let bounds = placement.bounds([low, high]).map(|corner| corner.as_vec3().to_array());
        Self { mesh, placement, bounds }
    }

    /// Largest magnitude of a coordinate in the scene.
    #[inline(always)]
    pub fn reach(&self) -> f32 {
        self.bounds.iter().flatten().fold(0.0, |most: f32, x| most.max(x.abs()))
    }
}

/// One coordinate of placed vertices: `row` of the linear part times the vertices, plus `offset`.
#[inline(always)]
fn place_axis<const N: usize>(row: [f64; 3], offset: f64, vertices: &[[f32; N]; 3]) -> [f32; N] {
    let mut placed = [0.0; N];
    for i in 0..N {
        let (x, y) = (f64::from(vertices[0][i]), f64::from(vertices[1][i]));
        let z = f64::from(vertices[2][i]);
        placed[i] = (row[0] * x + row[1] * y + row[2] * z + offset) as f32;
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sheared(entries: [f64; 9]) -> DMat3 {
        DMat3::from_cols_array(&entries) + DMat3::IDENTITY * 3.0
    }

    proptest! {
        /// Boxes contain what they must, in both directions.
        #[test]
        fn boxes_contain_what_is_placed(
            entries in prop::array::uniform9(-1f64..1.0), offset in prop::array::uniform3(-1e3f64..1e3),
            p in prop::array::uniform3(-1f32..1.0),
        ) {
            let placement = Placement::new(sheared(entries), offset.into());
            let placed = doubles(placement.place(p));
            let all = Instance::new(0, placement, [DVec3::NEG_ONE, DVec3::ONE]).bounds.map(doubles);
            prop_assert!(all[0].cmple(placed).all() && placed.cmple(all[1]).all());
            let [low, high] = placement.bounds_in_mesh([placed, placed]);
            let p = doubles(p);
            prop_assert!(low.cmple(p).all() && p.cmple(high).all());
            prop_assert!((placement.to_mesh(placed) - p).abs().max_element() < 1e-3);
        }

        /// A placed normal is perpendicular to the placed surface, on the same side.
        #[test]
        fn normals_stay_perpendicular(
            entries in prop::array::uniform9(-1f64..1.0), mirror in any::<bool>(),
            a in prop::array::uniform3(-1f64..1.0), b in prop::array::uniform3(-1f64..1.0),
        ) {
            let flip = if mirror { DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)) } else { DMat3::IDENTITY };
            let placement = Placement::new(flip * sheared(entries), DVec3::ZERO);
            let (a, b) = (DVec3::from(a), DVec3::from(b));
            let normal = a.cross(b).normalize_or_zero();
            prop_assume!(a.cross(b).length() > 1e-2);
            let placed = doubles(placement.normal(normal.as_vec3().to_array()));
            for side in [a, b] {
                prop_assert!(placed.dot(placement.linear * side).abs() < 1e-5);
            }
            prop_assert!(placed.dot(placement.linear * normal) > 0.0);
        }
    }

    /// A sheared, mirrored map and its inverse. All numbers are exact in f64.
    #[test]
    fn boxes_are_as_wide_as_the_map_and_the_rounding() {
        let rows = [DVec3::new(2.0, 1.0, 0.0), DVec3::new(0.0, -4.0, 0.0), DVec3::Z * 2.0];
        let linear = DMat3::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose();
        let placement = Placement::new(linear, DVec3::new(16.0, -8.0, 2.0));
        let epsilon = f64::from(f32::EPSILON);
        let around = |center: DVec3, half: DVec3| [center - half, center + half];
        let mesh = [DVec3::new(-1.0, 0.0, 2.0), DVec3::new(3.0, 2.0, 8.0)];
        let half = DVec3::new(5.0, 4.0, 6.0) + 2.0 * 24.0 * epsilon;
        assert_eq!(placement.bounds(mesh), around(DVec3::new(19.0, -12.0, 12.0), half));
        let scene = [DVec3::new(15.0, -16.0, 3.0), DVec3::new(19.0, -8.0, 11.0)];
        let slack = 2.0 * (19.0 + 16.0) * epsilon;
        let half = DVec3::new(1.5, 1.0, 2.0) + slack * DVec3::new(0.625, 0.25, 0.5);
        assert_eq!(placement.bounds_in_mesh(scene), around(DVec3::new(0.0, 1.0, 2.5), half));
        assert_eq!(placement.inverse_norm(), 0.625);
        assert_eq!(placement.vector_to_mesh(DVec3::new(4.0, 8.0, 2.0)), DVec3::new(3.0, -2.0, 1.0));
        let instance = Instance::new(0, placement, mesh);
        assert_eq!(instance.reach(), instance.bounds[1][0]);
        let corners = placement.corners([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]);
        assert_eq!(corners, [[16.0, -8.0, 2.0], [18.0, -8.0, 2.0], [17.0, -12.0, 4.0]]);
    }
}
