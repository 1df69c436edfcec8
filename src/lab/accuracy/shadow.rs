//! Secondary rays from hits, created and traced as in a render. For `coursework`, shadow rays are
//! created as the coursework's program did.

use glam::{DVec3, Vec3};

use crate::accel::Accelerator;
use crate::accel::lane::lanes;
use crate::geometry::{Geometry, NONE, Surfaces, refine};
use crate::integrate::{Crevices, OWN_LANES, ShadowRays};
use crate::ray::{Coherence, LANES, Mask, RayKind, RayPacket, Rays};
use crate::scene::Backend;
use crate::shading::{
    self, Area, Falloff, Lanes3, LightWeights, ShadowPoints, lane, reflect, set_lane,
};

/// Distance by which the coursework moved origins of secondary rays along the normal, in world
/// units.
const COURSEWORK_OFFSET: f64 = 1e-4;

/// The surface points of a traced packet.
pub struct SurfacePoints {
    surfaces: Surfaces,
    points: ShadowPoints,
    crevices: Crevices,
}

impl SurfacePoints {
    /// Computes the surface points of the lanes in `hit`.
    pub fn new(
        (geometry, accelerator): (&Geometry, &dyn Accelerator),
        hit: &Mask,
        packet: &mut RayPacket,
    ) -> Self {
        let mut surfaces = Surfaces::EMPTY;
        refine(geometry, hit, packet, &mut surfaces);
        let mut crevices = Crevices::default();
        let mut at_edge = surfaces.at_edge;
        (0..LANES).for_each(|i| at_edge.0[i] &= hit.0[i]);
        if at_edge.any() {
            let scene = (geometry, accelerator);
            crevices.find(scene, RayKind::Camera, packet, &mut surfaces, &at_edge);
        }
        let mut points = ShadowPoints::EMPTY;
        points.hit = *hit;
        points.position = surfaces.position;
        points.origin = surfaces.outside;
        (points.ng, points.n) = (surfaces.ng, surfaces.ng);
        points.primitive = surfaces.primitive;
        points.kd = [1.0; LANES];
        for i in lanes(hit) {
            let direction = lane(&packet.rays.dir, i);
            set_lane(&mut points.view, i, -direction.normalize_or(Vec3::X));
        }
        Self { surfaces, points, crevices }
    }

    /// Position of lane `i`, rounded to f32.
    pub fn position(&self, i: usize) -> DVec3 {
        lane(&self.surfaces.position, i).as_dvec3()
    }

    /// Unit normal of lane `i`, on the side of the ray's origin.
    pub fn normal(&self, i: usize) -> DVec3 {
        lane(&self.surfaces.ng, i).as_dvec3()
    }

    /// Creates shadow rays to the light points, which may lie on an area light.
    pub fn shadow_rays<'a>(
        &self,
        backend: Backend,
        light: (&Lanes3, Option<&'a Area>),
    ) -> (ShadowRays<'a>, Rays) {
        let (mut rays, mut weights) = (Rays::EMPTY, LightWeights::EMPTY);
        let aimed =
            ShadowRays::aim(&self.points, light, Falloff::None, false, &mut rays, &mut weights);
        if backend == Backend::Coursework {
            for i in lanes(&aimed.active) {
                let origin = (self.position(i) + self.normal(i) * COURSEWORK_OFFSET).as_vec3();
                rays.set(i, origin, lane(light.0, i) - origin);
                (rays.tfar[i], rays.leaving[i]) = (1.0, NONE);
            }
        }
        (aimed, rays)
    }

    /// Traces shadow rays as in a render; for `coursework` by a plain occlusion query.
    pub fn trace(
        &self,
        backend: Backend,
        scene: (&Geometry, &dyn Accelerator),
        aimed: &ShadowRays,
        rays: &mut Rays,
        coherence: Coherence,
    ) {
        match backend {
            Backend::Coursework => scene.1.occluded(&aimed.active, rays, coherence),
            _ => aimed.trace(scene, &self.crevices, &OWN_LANES, rays, coherence),
        }
    }

    /// Creates and traces the mirrored rays of the points.
    pub fn mirrored(
        &self,
        (geometry, accelerator): (&Geometry, &dyn Accelerator),
        coherence: Coherence,
    ) -> (Mask, RayPacket) {
        let mut points = shading::Points::EMPTY;
        points.at = self.points.clone();
        points.kr = [1.0; LANES];
        let mut packet = RayPacket::EMPTY;
        let active = reflect(&points, &self.surfaces.outside, &mut packet.rays);
        let (done, _) = self.crevices.closest(geometry, accelerator, &active, &mut packet);
        accelerator.closest(&active.without(&done), &mut packet, coherence);
        (active, packet)
    }
}
