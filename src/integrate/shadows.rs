//! Shadow rays: from points to a light, and which of them arrive.

use super::crevices::Crevices;
use crate::accel::Accelerator;
use crate::geometry::Geometry;
use crate::ray::{Coherence, LANES, Mask, Rays};
use crate::scene::Falloff;
use crate::shading::{Area, Lanes3, Lit, ShadowPoints, light_rays};

/// The shadow rays of a packet of points to one light.
#[derive(Clone, Copy)]
pub struct ShadowRays<'a> {
    /// The area that the light points lie on; `None` for a point light.
    pub area: Option<&'a Area>,
    /// Which rays there are.
    pub active: Mask,
    /// Those whose light lies in a surface that they nearly run along.
    grazing: Mask,
}

impl<'a> ShadowRays<'a> {
    /// Aims `rays` from `points` at the light points `q`; `lit` is what arrives of those that nothing stops.
    /// `glossy`: whether any point has a specular term.
    #[inline(always)]
    pub fn aim(
        points: &ShadowPoints,
        (q, area): (&Lanes3, Option<&'a Area>),
        falloff: Falloff,
        glossy: bool,
        rays: &mut Rays,
        lit: &mut Lit,
    ) -> Self {
        let normal = area.and_then(|area| area.normal);
        let mut active = light_rays(points, q, normal, falloff, glossy, rays, lit);
        let grazing = match area {
            Some(area) if area.flush > 0.0 => area.end_before_plane(points, rays, &mut active),
            _ => Mask::NONE,
        };
        Self { area, active, grazing }
    }

    /// Traces them, ray `i` from the point of lane `from[i]` of those that have `crevices`: all at once but for
    /// rays from near edges, and those along the surface that the light lies in. Sets `tfar` to -inf where a ray is
    /// stopped.
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
        if crevices.is_empty() && !grazing.any() {
            return accelerator.occluded(active, rays, coherence);
        }
        let in_plane = |primitive| area.is_some_and(|area| area.holds(geometry, primitive));
        let scene = (geometry, accelerator);
        crevices.occluded(scene, active, rays, from, (grazing, &in_plane), coherence);
    }
}

/// Every ray from the point of its own lane.
pub const OWN: [usize; LANES] = {
    let mut own = [0; LANES];
    let mut i = 0;
    while i < LANES {
        own[i] = i;
        i += 1;
    }
    own
};
