//! The areas of textures that the samples of a packet stand for, for all lanes at once.

use glam::{DVec2, DVec3};

use super::mip_map::Footprint;
use super::points::{Lanes, Lanes3};
use crate::math::{cross, dot, sub};
use crate::ray::{LANES, Mask};

/// Smallest cosine between normal and ray; it limits the length of an area.
const MIN_COSINE: f64 = 1e-3;

/// Below this squared sine between normal and ray, the direction of the slant is that of rounding,
/// because the normal is a unit vector of f32 only.
const MIN_SQUARED_SINE: f64 = 1e-10;

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

    /// Returns the areas that cones of these widths cover on the surface. They are longer in the
    /// direction of the ray, because the surface is seen at an angle. Akenine-Möller et al. 2021,
    /// "Improved Shader and Texture Level of Detail Using Ray Cones", JCGT 10(1), section 4.
    ///
    /// An area has no size where u, v do not change, or change without bounds: on a triangle
    /// without area, at the pole of a sphere.
    #[inline(always)]
    pub fn footprints(&mut self, ng: &Lanes3, directions: &Lanes3, widths: &Lanes) -> Footprints {
        self.complete();
        let mut all = Footprints { sides: [[[0.0; LANES]; 2]; 2] };
        for i in 0..LANES {
            let (n, d) = (doubles(ng, i), doubles(directions, i));
            let along = dot(n, d);
            let [x, y, z] = [d[0] - n[0] * along, d[1] - n[1] * along, d[2] - n[2] * along];
            let square = x * x + y * y + z * z;
            let shrink = 1.0 / square.sqrt();
            let slanted = (square > MIN_SQUARED_SINE) & (shrink > 0.0);
            let across = perpendicular(n);
            let ahead = [x * shrink, y * shrink, z * shrink];
            let ahead = select(slanted, ahead, across);
            let aside = cross(n, ahead);
            let (width, cosine) = (f64::from(widths[i]), along.abs());
            let cosine = if cosine > MIN_COSINE { cosine } else { MIN_COSINE };
            for axis in 0..2 {
                let [gx, gy, gz] = &self.gradients[axis];
                let gradient = [gx[i], gy[i], gz[i]];
                all.sides[0][axis][i] = dot(ahead, gradient) * (width / cosine);
                all.sides[1][axis][i] = dot(aside, gradient) * width;
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

#[inline(always)]
fn select(first: bool, [ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [if first { ax } else { bx }, if first { ay } else { by }, if first { az } else { bz }]
}

/// A unit vector perpendicular to a unit vector. Duff et al. 2017, "Building an Orthonormal Basis,
/// Revisited", JCGT 6(1).
#[inline(always)]
fn perpendicular([x, y, z]: [f64; 3]) -> [f64; 3] {
    let sign = if z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + z);
    [1.0 + sign * x * x * a, sign * x * y * a, -sign * x]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area in lane 5 of a cone of width 0.1 that comes from `direction`.
    fn area(mut changes: UvChanges, normal: DVec3, direction: DVec3) -> [DVec2; 2] {
        let lanes = |v: DVec3| v.as_vec3().to_array().map(|x| [x; LANES]);
        changes.footprints(&lanes(normal), &lanes(direction), &[0.1; LANES]).of(5).sides
    }

    fn assert_near(found: [DVec2; 2], expected: [DVec2; 2]) {
        for (found, expected) in found.into_iter().zip(expected) {
            // A side may point either way.
            let off = (found - expected).length().min((found + expected).length());
            assert!(off < 1e-7, "{found} {expected}");
        }
    }

    #[test]
    fn an_area_is_longer_along_the_ray() {
        let mut changes = UvChanges::NONE;
        // u = 3 x, and v = 2 y in the file.
        changes.set_triangle(
            5,
            [[0.0; 3], [1.0, 0.0, 0.0], [0.5, 2.0, 0.0]],
            [[0.0; 2], [3.0, 0.0], [1.5, 4.0]],
        );
        let ray = DVec3::new(0.8, 0.0, -0.6);
        assert_near(area(changes, DVec3::Z, ray), [DVec2::X * (0.3 / 0.6), DVec2::Y * 0.2]);
        let mut changes = UvChanges::NONE;
        changes.set_gradients(5, [DVec3::X * 3.0, DVec3::Y * -2.0]);
        let ray = DVec3::new(0.0, 0.8, -0.6);
        assert_near(area(changes, DVec3::Z, ray), [DVec2::Y * (0.2 / 0.6), DVec2::X * 0.3]);
    }

    #[test]
    fn v_points_down() {
        let mut changes = UvChanges::NONE;
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        changes.set_triangle(5, corners, [[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]]);
        let [ahead, _] = area(changes, DVec3::Z, DVec3::new(0.8, 0.0, -0.6));
        assert!((ahead / (0.1 / 0.6) - DVec2::new(1.0, -0.5)).length() < 1e-6, "{ahead}");
    }

    #[test]
    fn a_ray_along_the_normal_covers_a_square() {
        for normal in [DVec3::Z, -DVec3::Z, DVec3::X, DVec3::new(0.48, -0.6, 0.64)] {
            let (u, v) = normal.any_orthonormal_pair();
            let mut changes = UvChanges::NONE;
            changes.set_gradients(5, [u, v]);
            let [a, b] = area(changes, normal, -normal);
            assert!((a.length() - 0.1).abs() < 1e-6 && (b.length() - 0.1).abs() < 1e-6);
            assert!(a.dot(b).abs() < 1e-8, "{a} {b}");
        }
    }

    #[test]
    fn a_triangle_without_area_has_no_footprint() {
        let mut changes = UvChanges::NONE;
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        changes.set_triangle(5, corners, [[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]]);
        assert_eq!(area(changes, DVec3::Z, -DVec3::Z), [DVec2::ZERO; 2]);
    }
}
