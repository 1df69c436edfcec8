//! Texture coordinates of a hit, in f64 from the ray and the primitive to the texel.

use glam::{DVec2, DVec3};

use crate::geometry::{Geometry, GeometryKind, Surfaces, doubles, exact_position};
use crate::ray::{RayPacket, lane};
use crate::scene::Wrap;

/// Source of a shape's texture coordinates.
#[derive(Debug, Clone)]
pub enum UvSource {
    /// The shape has no texture coordinates.
    None,
    /// Latitude and longitude of a sphere.
    Sphere {
        /// Axis of the poles: 0, 1 or 2.
        pole: u8,
    },
    /// Linear functions of the position on a plane or a single triangle, from the corners in f64.
    Linear(Box<UvFrame>),
    /// The same functions from the rounded corners of the geometry, for shapes without a texture.
    Corners,
    /// One coordinate pair per vertex of the mesh; v points up, as in the file.
    PerVertex(Vec<[f32; 2]>),
    /// Three coordinate pairs per triangle of the mesh; v points up, as in the file.
    PerCorner(Vec<[[f32; 2]; 3]>),
}

impl UvSource {
    /// Texture coordinates (u, v) at the hit of lane `i`, which must have hit this shape. v points
    /// down.
    pub(super) fn at(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        i: usize,
    ) -> Option<DVec2> {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let position = || exact_position(geometry, packet, surfaces, i);
        match (self, geometry.kind(geom)) {
            (Self::Sphere { pole }, GeometryKind::Spheres) => {
                Some(sphere_uv(position() - geometry.spheres[prim as usize].center, *pole))
            }
            (Self::Linear(frame), _) => Some(frame.at(position())),
            (Self::Corners, GeometryKind::Quads) => {
                let corners = geometry.quads[prim as usize].map(doubles);
                Some(UvFrame::from_quad(&corners).at(position()))
            }
            (Self::Corners, GeometryKind::Mesh(mesh)) => {
                let corners = geometry.meshes[mesh].corners(prim).map(doubles);
                Some(UvFrame::from_triangle(&corners).at(position()))
            }
            (Self::PerVertex(uv), _) => {
                let corners = geometry.mesh(geom)?.0.triangles()[prim as usize];
                Some(file_uv(corners.map(|corner| uv[corner as usize]), surfaces.weights(i)))
            }
            (Self::PerCorner(uv), _) => Some(file_uv(uv[prim as usize], surfaces.weights(i))),
            _ => None,
        }
    }

    /// Coordinates of the file at the corners of a triangle of a mesh; v points up.
    #[inline(always)]
    pub(super) fn of_triangle(
        &self,
        geometry: &Geometry,
        geom: u32,
        prim: u32,
    ) -> Option<[[f32; 2]; 3]> {
        match self {
            Self::PerVertex(uv) => {
                let [a, b, c] = geometry.mesh(geom)?.0.triangles()[prim as usize];
                Some([uv[a as usize], uv[b as usize], uv[c as usize]])
            }
            Self::PerCorner(uv) => Some(uv[prim as usize]),
            _ => None,
        }
    }

    /// Gradients of u and v over the position in the surface of a sphere or a flat shape, at the
    /// hit of lane `i`. v points down. Zero for the triangles of [`UvSource::of_triangle`].
    pub(super) fn gradients(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        i: usize,
    ) -> [DVec3; 2] {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        match (self, geometry.kind(geom)) {
            (Self::Sphere { pole }, GeometryKind::Spheres) => {
                let position = lane(&surfaces.position, i).as_dvec3();
                sphere_gradients(position - geometry.spheres[prim as usize].center, *pole)
            }
            (Self::Linear(frame), _) => [frame.u, frame.v],
            _ => [DVec3::ZERO; 2],
        }
    }

    /// Default wrap mode in u and in v, for scenes that set none.
    pub(super) fn wrap(&self) -> [Wrap; 2] {
        match self {
            Self::Sphere { .. } => [Wrap::Repeat, Wrap::Clamp],
            Self::PerVertex(_) | Self::PerCorner(_) => [Wrap::Repeat; 2],
            Self::None | Self::Linear(_) | Self::Corners => [Wrap::Clamp; 2],
        }
    }

    /// Heap memory in bytes.
    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::PerVertex(uv) => size_of_val(&uv[..]),
            Self::PerCorner(uv) => size_of_val(&uv[..]),
            Self::Linear(frame) => size_of_val(&**frame),
            Self::None | Self::Sphere { .. } | Self::Corners => 0,
        }
    }
}

/// Interpolates coordinates of a file, and flips v to point down.
fn file_uv(corners: [[f32; 2]; 3], weights: [f64; 3]) -> DVec2 {
    let [a, b, c] = corners.map(|uv| DVec2::from(uv.map(f64::from)));
    let mean = a * weights[0] + b * weights[1] + c * weights[2];
    DVec2::new(mean.x, 1.0 - mean.y)
}

/// Gradients of [`sphere_uv`] over the sphere at the arm `p`; not finite at the poles.
fn sphere_gradients(p: DVec3, pole: u8) -> [DVec3; 2] {
    use std::f64::consts::{PI, TAU};
    let p = to_poles(p, pole);
    let square = p.x * p.x + p.y * p.y;
    let (u, v) = (DVec3::new(-p.y, p.x, 0.0) / (TAU * square), -1.0 / (PI * square.sqrt()));
    [u, DVec3::new(0.0, 0.0, v)].map(|gradient| from_poles(gradient, pole))
}

/// Moves the axis `pole` to z.
fn to_poles(p: DVec3, pole: u8) -> DVec3 {
    match pole {
        0 => DVec3::new(p.y, p.z, p.x),
        1 => DVec3::new(p.z, p.x, p.y),
        _ => p,
    }
}

/// Moves z back to the axis `pole`.
fn from_poles(p: DVec3, pole: u8) -> DVec3 {
    match pole {
        0 => DVec3::new(p.z, p.x, p.y),
        1 => DVec3::new(p.y, p.z, p.x),
        _ => p,
    }
}

/// Texture coordinates u and v as linear functions of the position.
#[derive(Debug, Clone, Copy)]
pub struct UvFrame {
    /// Position at which (u, v) is `start`, relative to the scene's origin.
    corner: DVec3,
    start: DVec2,
    /// Gradient of u over the position.
    u: DVec3,
    /// Gradient of v over the position.
    v: DVec3,
}

impl UvFrame {
    /// The frame of a quad. With a = v2 - v3, b = v0 - v3: u = (P - v3).a/|a|^2, v = 1 - (P -
    /// v3).b/|b|^2. Corners are relative to the scene's origin.
    pub fn from_quad(&[v0, _, v2, v3]: &[DVec3; 4]) -> Self {
        let (a, b) = (v2 - v3, v0 - v3);
        Self { corner: v3, start: DVec2::Y, u: a / a.dot(a), v: -b / b.dot(b) }
    }

    /// The frame of a triangle. With e = v1 - v0, h the part of v2 - v0 perpendicular to e, and [m,
    /// M] the range of the corners along e: u = 1 - ((P - v0).e/|e| - m)/(M - m), v = (P -
    /// v0).h/|h|^2. Corners are relative to the scene's origin.
    pub fn from_triangle(corners: &[DVec3; 3]) -> Self {
        let [v0, v1, v2] = *corners;
        let e = (v1 - v0).normalize();
        let h = (v2 - v0) - e * (v2 - v0).dot(e);
        let along = corners.map(|p| (p - v0).dot(e));
        let (low, high) =
            along.iter().fold((f64::MAX, f64::MIN), |(l, h), &x| (l.min(x), h.max(x)));
        let range = high - low;
        let start = DVec2::new(1.0 + low / range, 0.0);
        Self { corner: v0, start, u: -e / range, v: h / h.dot(h) }
    }

    fn at(&self, position: DVec3) -> DVec2 {
        let d = position - self.corner;
        self.start + DVec2::new(d.dot(self.u), d.dot(self.v))
    }
}

/// Latitude and longitude of a direction of any length: `u = 0.5 + atan2(p.x, -p.y)/(2 pi)`, `v =
/// 0.5 - asin(p.z/|p|)/pi`, with the poles moved to the axis `pole`. The arcsine is computed as an
/// arctangent, which keeps its digits at the poles.
fn sphere_uv(p: DVec3, pole: u8) -> DVec2 {
    use std::f64::consts::{PI, TAU};
    let p = to_poles(p, pole);
    let u = 0.5 + p.x.atan2(-p.y) / TAU;
    let v = 0.5 - p.z.atan2((p.x * p.x + p.y * p.y).sqrt()) / PI;
    DVec2::new(u, v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sphere_coordinates_of_known_points() {
        let at = |p: DVec3, pole| sphere_uv(p * 3.0, pole).to_array();
        assert_eq!(at(-DVec3::Y, 2), [0.5, 0.5]);
        assert_eq!(at(DVec3::X, 2), [0.75, 0.5]);
        assert_eq!(at(-DVec3::X, 2), [0.25, 0.5]);
        assert_eq!(at(DVec3::Z, 2)[1], 0.0);
        assert_eq!(at(-DVec3::Z, 2)[1], 1.0);
        assert_eq!(at(DVec3::X, 0)[1], 0.0);
        assert_eq!(at(DVec3::Y, 1)[1], 0.0);
        assert_eq!(at(-DVec3::Z, 0), [0.5, 0.5]);
    }

    #[test]
    fn changes_on_a_sphere_are_differences() {
        let h = 1e-6;
        for pole in 0..3 {
            for p in [
                DVec3::new(0.3, -0.5, 0.7),
                DVec3::new(-0.8, -0.1, 0.2),
                DVec3::new(0.1, 0.9, -0.4),
            ] {
                for across in [p.cross(DVec3::X), p.cross(DVec3::new(0.2, 0.5, -1.0))] {
                    let d = across * h;
                    let expected = sphere_uv(p + d / 2.0, pole) - sphere_uv(p - d / 2.0, pole);
                    let [u, v] = sphere_gradients(p, pole);
                    let found = DVec2::new(d.dot(u), d.dot(v));
                    assert!((found - expected).length() < 1e-4 * expected.length(), "{p} {pole}");
                }
            }
        }
    }

    #[test]
    fn a_plane_maps_v3_to_the_bottom_left() {
        let corners = [DVec3::Y, DVec3::new(2.0, 1.0, 0.0), DVec3::X * 2.0, DVec3::ZERO];
        let [v0, v1, v2, v3] = corners.map(|p| UvFrame::from_quad(&corners).at(p));
        assert_eq!([v3, v2, v0, v1], [DVec2::Y, DVec2::ONE, DVec2::ZERO, DVec2::X]);
    }

    #[test]
    fn a_triangle_maps_into_its_bounding_rectangle() {
        let at_corners =
            |corners: [DVec3; 3]| corners.map(|p| UvFrame::from_triangle(&corners).at(p));
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::new(1.0, 2.0, 0.0)];
        assert_eq!(at_corners(corners), [DVec2::X, DVec2::ZERO, DVec2::new(0.75, 1.0)]);
        // A third corner outside of the first edge's range widens the range.
        let corners = [DVec3::ZERO, DVec3::X * 4.0, DVec3::new(-4.0, 2.0, 0.0)];
        assert_eq!(at_corners(corners)[0].x, 0.5);
    }
}
