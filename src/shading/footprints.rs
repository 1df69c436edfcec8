//! The areas of textures that the samples of a packet stand for, for all lanes at once.

use glam::{DVec2, DVec3};

use super::mip_map::Footprint;
use super::points::{Lanes, Lanes3};
use crate::math::{cross, dot, sub};
use crate::ray::{LANES, Mask};

/// One double per lane.
type Doubles = [f64; LANES];

/// How texture coordinates change around the hits of a packet.
pub struct UvChanges {
    /// By corner of the triangles of meshes: its position relative to the scene's origin.
    corners: [Lanes3; 3],
    /// By corner of the triangles of meshes: u and v, which points up.
    uv: [[Lanes; 2]; 3],
    /// Lanes that hit a triangle of a mesh.
    triangles: Mask,
    /// Gradients of u and of v, which points down, over the position. Those of triangles are not
    /// computed yet.
    gradients: [[Doubles; 3]; 2],
}

impl UvChanges {
    /// No lane has coordinates.
    pub const NONE: Self = Self {
        corners: [[[0.0; LANES]; 3]; 3],
        uv: [[[0.0; LANES]; 2]; 3],
        triangles: Mask::NONE,
        gradients: [[[0.0; LANES]; 3]; 2],
    };

    /// Sets the triangle of a mesh in lane `i`, with the coordinates of the file.
    #[inline(always)]
    pub fn set_triangle(&mut self, i: usize, corners: [[f32; 3]; 3], uv: [[f32; 2]; 3]) {
        for c in 0..3 {
            for axis in 0..3 {
                self.corners[c][axis][i] = corners[c][axis];
            }
            for axis in 0..2 {
                self.uv[c][axis][i] = uv[c][axis];
            }
        }
        self.triangles.0[i] = -1;
    }

    /// Sets the gradients of u and v over the position in lane `i`. v points down.
    #[inline(always)]
    pub fn set_gradients(&mut self, i: usize, gradients: [DVec3; 2]) {
        for (to, from) in self.gradients.iter_mut().zip(gradients) {
            (to[0][i], to[1][i], to[2][i]) = (from.x, from.y, from.z);
        }
    }

    /// Returns the areas of textures with these sides on the surfaces.
    ///
    /// An area has no size where u, v do not change, or change without bounds: on a triangle
    /// without area, at the pole of a sphere.
    #[inline(always)]
    pub fn footprints(&mut self, sides: &[Lanes3; 2]) -> Footprints {
        self.complete();
        let mut all = Footprints { sides: [[[0.0; LANES]; 2]; 2] };
        for side in 0..2 {
            for axis in 0..2 {
                let [gx, gy, gz] = &self.gradients[axis];
                for i in 0..LANES {
                    let change = doubles(&sides[side], i);
                    all.sides[side][axis][i] = dot(change, [gx[i], gy[i], gz[i]]);
                }
            }
        }
        all
    }

    /// Computes the gradients of triangles.
    #[inline(always)]
    fn complete(&mut self) {
        for i in 0..LANES {
            let a = doubles(&self.corners[0], i);
            let e1 = sub(doubles(&self.corners[1], i), a);
            let e2 = sub(doubles(&self.corners[2], i), a);
            let n = cross(e1, e2);
            let scale = 1.0 / dot(n, n);
            // Gradients of the weights of the second and third corner.
            let (second, third) = (cross(e2, n), cross(n, e1));
            for axis in 0..2 {
                let start = f64::from(self.uv[0][axis][i]);
                let flip = if axis == 0 { scale } else { -scale };
                let b = (f64::from(self.uv[1][axis][i]) - start) * flip;
                let c = (f64::from(self.uv[2][axis][i]) - start) * flip;
                for k in 0..3 {
                    let own = second[k] * b + third[k] * c;
                    let gradient = &mut self.gradients[axis][k][i];
                    *gradient = if self.triangles.0[i] != 0 { own } else { *gradient };
                }
            }
        }
    }
}

/// The areas of textures of a packet.
pub struct Footprints {
    /// By side, then u and v.
    sides: [[Doubles; 2]; 2],
}

impl Footprints {
    /// Returns the area of lane `i`.
    #[inline(always)]
    pub fn of(&self, i: usize) -> Footprint {
        Footprint { sides: [self.side(0, i), self.side(1, i)] }
    }

    #[inline(always)]
    fn side(&self, side: usize, i: usize) -> DVec2 {
        let [u, v] = &self.sides[side];
        let side = DVec2::new(u[i], v[i]);
        if side.is_finite() { side } else { DVec2::ZERO }
    }
}

/// The vector of lane `i`.
#[inline(always)]
fn doubles([x, y, z]: &Lanes3, i: usize) -> [f64; 3] {
    [f64::from(x[i]), f64::from(y[i]), f64::from(z[i])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area in lane 5 with these sides on the surface.
    fn area(mut changes: UvChanges, sides: [DVec3; 2]) -> [DVec2; 2] {
        let lanes = |v: DVec3| v.as_vec3().to_array().map(|x| [x; LANES]);
        changes.footprints(&sides.map(lanes)).of(5).sides
    }

    #[test]
    fn sides_follow_the_coordinates_of_a_triangle() {
        let mut changes = UvChanges::NONE;
        // u = 3 x, and v = 2 y in the file, where it points up.
        changes.set_triangle(
            5,
            [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 2.0, 0.0]],
            [[0.0; 2], [3.0, 0.0], [1.5, 4.0]],
        );
        let [a, b] = area(changes, [DVec3::new(0.5, 0.25, 7.0), DVec3::new(-0.125, 0.5, -3.0)]);
        assert!((a - DVec2::new(1.5, -0.5)).length() < 1e-7, "{a}");
        assert!((b - DVec2::new(-0.375, -1.0)).length() < 1e-7, "{b}");
    }

    #[test]
    fn sides_follow_gradients() {
        let mut changes = UvChanges::NONE;
        changes.set_gradients(5, [DVec3::X * 3.0, DVec3::new(0.0, -2.0, 1.0)]);
        let [a, b] = area(changes, [DVec3::new(0.5, 0.25, 0.0), DVec3::Z * 4.0]);
        assert_eq!([a, b], [DVec2::new(1.5, -0.5), DVec2::new(0.0, 4.0)]);
    }

    #[test]
    fn a_triangle_without_area_has_no_footprint() {
        let mut changes = UvChanges::NONE;
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        changes.set_triangle(5, corners, [[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]]);
        assert_eq!(area(changes, [DVec3::X, DVec3::Y]), [DVec2::ZERO; 2]);
    }
}
