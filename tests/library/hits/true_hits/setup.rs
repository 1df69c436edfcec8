//! Geometries, backends over them, and packets of rays.

use glam::DVec3;
use lightpath::accel::brute::Brute;
use lightpath::geometry::{Geometry, TriangleMesh};
use lightpath::monitor::Monitor;
use lightpath::ray::{LANES, Mask, RayPacket, Rays};

use crate::support::backends::OPTIONS;
use crate::support::random::Random;

pub const ALL: Mask = Mask::ALL;

pub fn geometry(
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    quads: Vec<[[f32; 3]; 4]>,
) -> Geometry {
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], quads, vec![]).unwrap()
}

pub fn oracle(geometry: &Geometry) -> Brute<'_> {
    Brute::build(geometry, &OPTIONS, &Monitor::default()).unwrap()
}

/// Returns 16 rays, each from an origin and a direction.
pub fn packet(mut ray: impl FnMut() -> (DVec3, DVec3)) -> RayPacket {
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        let (origin, direction) = ray();
        for axis in 0..3 {
            rays.org[axis][i] = origin[axis] as f32;
            rays.dir[axis][i] = direction[axis] as f32;
        }
    }
    RayPacket { rays, ..RayPacket::EMPTY }
}

/// Returns a point in [-1, 1)^3.
pub fn cube(random: &mut Random) -> DVec3 {
    DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0
}

/// Returns a point on the unit sphere.
pub fn unit(random: &mut Random) -> DVec3 {
    loop {
        let v = cube(random);
        if (1e-4..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}
