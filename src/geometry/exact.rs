//! The point of one hit in f64, for what single precision is too coarse for.

use glam::DVec3;

use super::surface::{hit_corners, on_sphere};
use super::{Geometry, Surfaces};
use crate::ray::RayPacket;

/// Where lane `i` of a traced packet, which hit, meets its primitive: relative to the scene's origin, to f64
/// rounding. `surfaces` are the packet's ([`super::refine`]), which hold the same point rounded.
pub fn exact_position(
    geometry: &Geometry,
    packet: &RayPacket,
    surfaces: &Surfaces,
    i: usize,
) -> DVec3 {
    let Some(([a, b, c], _)) = hit_corners(geometry, packet, i) else {
        let sphere = geometry.spheres[packet.hits.prim[i] as usize];
        return sphere.center + on_sphere(&sphere, packet, i).1 * sphere.radius;
    };
    let [wa, wb, wc] = surfaces.weights(i);
    a * wa + b * wb + c * wc
}
