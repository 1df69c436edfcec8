//! The hits of camera rays of which it is known that all hit one triangle: they are not traced.

use glam::DVec3;

use crate::geometry::Geometry;
use crate::ray::{LANES, Mask, RayPacket, lane};

/// How far inside the triangle a ray must pass, relative to products of coordinates: 1024u (u =
/// 2^-24). The tests of backends move corners by less than 8u of their distance from the origin,
/// and rounding moves directions by 2u.
const MARGIN: f64 = 1024.0 / (1u64 << 24) as f64;

/// Least height of the origin above the triangle's plane, relative to the triangle.
const HEIGHT: f64 = 1.0 / (1u64 << 10) as f64;

/// A triangle, or a half of a quad, that all rays of a cone hit first.
#[derive(Debug, Clone, Copy)]
pub struct SoleTriangle {
    geom: u32,
    prim: u32,
    /// Both weights of a reported hit. They only tell the halves of a quad apart: refinement
    /// computes the weights again.
    weight: f32,
    /// A direction hits the plane at the parameter `volume` / `normal` . direction.
    normal: DVec3,
    volume: f64,
}

impl SoleTriangle {
    /// The triangle or half of a quad that all rays inside a cone hit, if there is one and the rays
    /// can hit nothing but `primitive`. `directions` are the unit directions of the cone's corners.
    ///
    /// A direction is on the inner side of the planes through the origin and the edges if the
    /// corners' directions are, because it is a sum of them.
    pub fn new(
        geometry: &Geometry,
        primitive: u32,
        origin: DVec3,
        directions: [DVec3; 4],
    ) -> Option<Self> {
        let (geom, prim) = geometry.place(primitive);
        geometry.triangles(geom, prim).find_map(|(corners, second_half)| {
            let [a, b, c] = corners.map(|corner| corner - origin);
            let far = a.abs().max(b.abs()).max(c.abs()).max_element();
            let volume = a.dot(b.cross(c));
            let edges = [a.cross(b), b.cross(c), c.cross(a)].map(|edge| edge * volume.signum());
            let inside = |d: DVec3| edges.iter().all(|edge| edge.dot(d) > MARGIN * far * far);
            let hit = volume.abs() > HEIGHT * far * far * far && directions.into_iter().all(inside);
            hit.then(|| Self {
                geom,
                prim,
                weight: if second_half { 0.75 } else { 0.25 },
                normal: edges[0] + edges[1] + edges[2],
                volume: volume.abs(),
            })
        })
    }

    /// Writes the hits of the active rays, which must lie in the cone.
    #[inline(always)]
    pub fn hit(&self, active: &Mask, packet: &mut RayPacket) {
        for i in 0..LANES {
            let t = self.volume / self.normal.dot(lane(&packet.rays.dir, i).as_dvec3());
            let hits = &mut packet.hits;
            let is_active = active.0[i] != 0;
            hits.geom[i] = if is_active { self.geom } else { hits.geom[i] };
            hits.prim[i] = if is_active { self.prim } else { hits.prim[i] };
            hits.u[i] = if is_active { self.weight } else { hits.u[i] };
            hits.v[i] = if is_active { self.weight } else { hits.v[i] };
            let tfar = packet.rays.tfar[i];
            packet.rays.tfar[i] = if is_active { t as f32 } else { tfar };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::bvh::Bvh;
    use crate::accel::{Accelerator, BuildOptions};
    use crate::monitor::Monitor;
    use crate::ray::{Coherence, Rays, set_lane};
    use crate::simd::Isa;

    /// A floor of 20 x 20 units, seen from a height of 1.
    fn floor() -> Geometry {
        let (n, f) = (-10.0, 10.0);
        let quad = [[n, 0.0, f], [f, 0.0, f], [f, 0.0, n], [n, 0.0, n]];
        Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![]).unwrap()
    }

    fn corners(x: f64, z: f64, side: f64) -> [DVec3; 4] {
        let at = |dx: f64, dz: f64| DVec3::new(x + side * dx, -1.0, z + side * dz).normalize();
        [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)]
    }

    #[test]
    fn hits_are_those_of_the_backend() {
        let geometry = floor();
        let options = BuildOptions { threads: 1, max_bytes: None };
        let bvh = Bvh::build(&geometry, Isa::detect(), &options, &Monitor::default()).unwrap();
        let (mut found, origin) = (0, DVec3::Y);
        for step in 0..400 {
            let (x, z) = (f64::from(step % 20) - 10.0, f64::from(step / 20) - 10.0);
            let cone = corners(x, z, 0.875);
            let Some(sole) = SoleTriangle::new(&geometry, 0, origin, cone) else { continue };
            found += 1;
            let mut rays = Rays::EMPTY;
            for i in 0..LANES {
                let (a, b) = ((i % 4) as f64 / 3.0, (i / 4) as f64 / 3.0);
                let [d, e, f, g] = cone;
                let direction = d.lerp(e, a).lerp(f.lerp(g, a), b).normalize();
                set_lane(&mut rays.org, i, origin.as_vec3());
                set_lane(&mut rays.dir, i, direction.as_vec3());
                rays.tfar[i] = f32::INFINITY;
            }
            let mut traced = RayPacket { rays, ..RayPacket::EMPTY };
            let mut known = traced.clone();
            let mut active = Mask::ALL;
            active.0[5] = 0;
            bvh.closest(&active, &mut traced, Coherence::Coherent);
            sole.hit(&active, &mut known);
            assert_eq!((known.hits.geom, known.hits.prim), (traced.hits.geom, traced.hits.prim));
            for i in (0..LANES).filter(|&i| active.0[i] != 0) {
                let first = |packet: &RayPacket| packet.hits.u[i] + packet.hits.v[i] <= 1.0;
                assert_eq!(first(&known), first(&traced));
                let off = (known.rays.tfar[i] / traced.rays.tfar[i] - 1.0).abs();
                assert!(off < 1e-6, "{off}");
            }
            assert_eq!(known.rays.tfar[5], f32::INFINITY);
        }
        // All squares but those on two edges and along the diagonal.
        assert_eq!(found, 400 - 39 - 19);
    }

    #[test]
    fn cones_across_an_edge_or_near_the_plane_have_no_sole_triangle() {
        let geometry = floor();
        let sole = |origin, cone| SoleTriangle::new(&geometry, 0, origin, cone);
        assert!(sole(DVec3::Y, corners(3.0, 4.5, 0.25)).is_some());
        for cone in [corners(9.5, 2.0, 1.0), corners(-0.5, -0.5, 1.0), corners(20.0, 0.0, 1.0)] {
            assert!(sole(DVec3::Y, cone).is_none(), "{cone:?}");
        }
        // The cone looks away from the floor.
        assert!(sole(DVec3::Y, corners(3.0, 4.5, 0.25).map(|d| -d)).is_none());
        assert!(sole(DVec3::Y * 1e-3, corners(3.0, 4.5, 0.25)).is_none());
    }
}
