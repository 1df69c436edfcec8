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

#[cfg(test)]
mod tests {
    use super::super::sphere::Sphere;
    use super::*;

    #[test]
    fn the_point_on_a_sphere_is_a_radius_away_from_the_centre() {
        let center = DVec3::new(1.0, 2.0, 3.0);
        let spheres =
            vec![Sphere { center: DVec3::ZERO, radius: 1.0 }, Sphere { center, radius: 2.0 }];
        let geometry = Geometry::new(DVec3::ZERO, vec![], vec![], spheres).unwrap();
        let mut packet = RayPacket::EMPTY;
        packet.rays.set(5, glam::Vec3::new(1.0, 2.0, -7.0), glam::Vec3::Z);
        packet.rays.tfar[5] = 8.0;
        (packet.hits.geom[5], packet.hits.prim[5]) = (geometry.spheres_id(), 1);
        let position = exact_position(&geometry, &packet, &Surfaces::EMPTY, 5);
        assert_eq!(position, DVec3::new(1.0, 2.0, 1.0));
    }
}
