//! From a hit to its shadow rays, as rendering goes; and as the coursework did.

use glam::{DVec3, Vec3};

use crate::accel::lane::lanes;
use crate::geometry::{Geometry, NONE, Surfaces, refine};
use crate::ray::{LANES, Mask, RayPacket, Rays};
use crate::scene::Backend;
use crate::shading::{Falloff, Lanes3, Lit, ShadowPoints, lane, light_rays, set_lane};

/// How far the coursework moved the origins of secondary rays along the normal, in world units.
const COURSEWORK_OFFSET: f64 = 1e-4;

/// The surface points of a traced packet.
pub struct Points {
    surfaces: Surfaces,
    points: ShadowPoints,
}

impl Points {
    /// Of the lanes that `hit`.
    pub fn new(geometry: &Geometry, hit: &Mask, packet: &RayPacket) -> Self {
        let mut surfaces = Surfaces::EMPTY;
        refine(geometry, hit, packet, &mut surfaces);
        let mut points = ShadowPoints::EMPTY;
        points.hit = *hit;
        points.position = surfaces.position;
        points.origin = surfaces.outside;
        (points.ng, points.n) = (surfaces.ng, surfaces.ng);
        points.primitive = surfaces.primitive;
        points.kd = [1.0; LANES];
        for i in lanes(hit) {
            let direction = Vec3::from([0, 1, 2].map(|k| packet.rays.dir[k][i]));
            set_lane(&mut points.view, i, -direction.normalize_or(Vec3::X));
        }
        Self { surfaces, points }
    }

    /// Position of lane `i`, rounded to f32.
    pub fn position(&self, i: usize) -> DVec3 {
        lane(&self.surfaces.position, i).as_dvec3()
    }

    /// Unit normal of lane `i`, turned to the ray.
    pub fn normal(&self, i: usize) -> DVec3 {
        lane(&self.surfaces.ng, i).as_dvec3()
    }

    /// The rays to the lights `q`, and which there are.
    pub fn shadow_rays(&self, backend: Backend, q: &Lanes3) -> (Mask, Rays) {
        let (mut rays, mut lit) = (Rays::EMPTY, Lit::EMPTY);
        let active = light_rays(&self.points, q, None, Falloff::None, false, &mut rays, &mut lit);
        if backend == Backend::Coursework {
            for i in lanes(&active) {
                let origin = self.position(i) + self.normal(i) * COURSEWORK_OFFSET;
                let origin = origin.as_vec3();
                set_lane(&mut rays.org, i, origin);
                set_lane(&mut rays.dir, i, lane(q, i) - origin);
                (rays.tfar[i], rays.leaving[i]) = (1.0, NONE);
            }
        }
        (active, rays)
    }
}
