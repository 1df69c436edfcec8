//! Shadow rays from shading points to a light.

use super::crevices::Crevices;
use crate::accel::Accelerator;
use crate::geometry::Geometry;
use crate::ray::{Coherence, LANES, Mask, Rays};
use crate::scene::Falloff;
use crate::shading::{
    Area, Distant, Lanes3, LightWeights, ShadowPoints, keep_directions, light_rays,
};

/// The shadow rays of a packet of shading points to one light.
#[derive(Clone, Copy)]
pub struct ShadowRays<'a> {
    /// Area that the light points lie on; `None` for a point light.
    pub area: Option<&'a Area>,
    /// Lanes that have a shadow ray.
    pub active: Mask,
    /// Rays that nearly run along the surface in which their light lies.
    grazing: Mask,
}

impl<'a> ShadowRays<'a> {
    /// Creates `rays` from `points` to the light points `q`. Sets `weights` to the weights of the
    /// light that arrives if nothing occludes the ray. `glossy`: whether any shading point has a
    /// specular term.
    ///
    /// For a light with a map, [`ShadowRays::colors`] must then divide the weights by the density
    /// of the light points.
    #[inline(always)]
    pub fn aim(
        points: &ShadowPoints,
        (q, area): (&Lanes3, Option<&'a Area>),
        falloff: Falloff,
        glossy: bool,
        rays: &mut Rays,
        weights: &mut LightWeights,
    ) -> Self {
        let normal = area.and_then(|area| area.normal);
        let falloff = area.map_or(falloff, |area| area.falloff(falloff));
        let mut active = light_rays(points, q, normal, falloff, glossy, rays, weights);
        if let Some(distant) = area.and_then(|area| area.distant.as_ref()) {
            keep_directions(points, q, distant.is_beyond(), rays);
            match distant {
                Distant::Environment(environment) if environment.map().is_none() => {
                    environment.weigh(points, q, weights);
                }
                _ => {}
            }
        }
        let grazing = match area {
            Some(area) if area.plane_gap > 0.0 => area.end_before_plane(points, rays, &mut active),
            _ => Mask::NONE,
        };
        Self { area, active, grazing }
    }

    /// Colours of the light points of an environment's image; `None` for other lights. Divides
    /// their weights by their density.
    #[inline(always)]
    pub fn colors(
        &self,
        points: &ShadowPoints,
        q: &Lanes3,
        weights: &mut LightWeights,
    ) -> Option<Lanes3> {
        Some(self.area?.map()?.weigh(points, q, weights))
    }

    /// Whether the backend alone decides which rays are occluded.
    #[inline(always)]
    pub fn is_plain(&self, crevices: &Crevices) -> bool {
        crevices.is_empty() && !self.grazing.any()
    }

    /// Traces the rays; `tfar` becomes -inf where a ray is occluded. Ray `i` starts at the point of
    /// lane `from[i]`, whose crevice may be in `crevices`. Rays from near edges, and rays along the
    /// surface that contains the light, are traced one by one.
    #[inline(always)]
    pub fn trace(
        &self,
        (geometry, accelerator): (&Geometry, &dyn Accelerator),
        crevices: &Crevices,
        from: &[usize; LANES],
        rays: &mut Rays,
        coherence: Coherence,
    ) {
        let Self { area, active, grazing } = self;
        if self.is_plain(crevices) {
            return accelerator.occluded(active, rays, coherence);
        }
        let in_plane = |primitive| area.is_some_and(|area| area.holds(geometry, primitive));
        let scene = (geometry, accelerator);
        crevices.occluded(scene, active, rays, from, (grazing, &in_plane), coherence);
    }
}

/// Lane indices for rays that start at the point of their own lane.
pub const OWN_LANES: [usize; LANES] = {
    let mut own = [0; LANES];
    let mut i = 0;
    while i < LANES {
        own[i] = i;
        i += 1;
    }
    own
};
