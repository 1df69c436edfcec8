//! The point of one hit in f64, for what single precision is too coarse for.

use glam::DVec3;

use super::surface::on_sphere;
use super::{Geometry, GeometryKind, Surfaces};
use crate::ray::RayPacket;

/// Where lane `i` of a traced packet, which hit, meets its primitive: relative to the scene's origin, to f64
/// rounding. `surfaces` are the packet's ([`super::refine`]), which hold the same point rounded.
pub fn exact_position(
    geometry: &Geometry,
    packet: &RayPacket,
    surfaces: &Surfaces,
    i: usize,
) -> DVec3 {
    let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
    let corners = match geometry.kind(geom) {
        GeometryKind::Mesh(mesh) => geometry.meshes[mesh].corners(prim),
        GeometryKind::Quads => geometry.quad_half(prim, packet.hits.u[i], packet.hits.v[i]).0,
        GeometryKind::Spheres => {
            let sphere = geometry.spheres[prim as usize];
            return sphere.center + on_sphere(&sphere, packet, i).1 * sphere.radius;
        }
    };
    let [a, b, c] = corners.map(|corner| DVec3::from(corner.map(f64::from)));
    let [wa, wb, wc] = surfaces.weights(i);
    a * wa + b * wb + c * wc
}
