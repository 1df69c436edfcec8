//! The point of one hit in f64, for uses that f32 is too coarse for.

use glam::DVec3;

use super::primitives::Geometry;
use super::surface::{Surfaces, hit_corners, on_sphere};
use crate::ray::RayPacket;

/// Position of the hit of lane `i`, relative to the scene's origin, to f64 rounding. The lane must
/// have hit. `surfaces` are the packet's surface points ([`super::refine`]); they hold the same
/// point rounded to f32.
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
