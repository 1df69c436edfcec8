//! Finds packets whose points see a whole light, or none of it, without tracing shadow rays.

use super::skips::Skips;
use crate::accel::{Accelerator, Shaft};
use crate::ray::{LANES, Mask, NONE};
use crate::shading::{Area, ShadowPoints, lane};

/// Margin for the rounding of dot products in f32 whose signs count, relative to coordinates.
const MARGIN: f32 = 16.0 * f32::EPSILON;

/// How much of an area light the points of a packet see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// No point of the light lies above the horizon of any shading point.
    Dark,
    /// No shadow ray is occluded.
    Clear,
    /// Shadow rays must be traced.
    Unknown,
}

/// Queries of the lights' shafts.
#[derive(Debug, Default)]
pub struct LightShafts {
    by_light: Vec<Skips>,
}

impl LightShafts {
    /// Creates the state for this many lights.
    pub fn new(lights: usize) -> Self {
        Self { by_light: vec![Skips::default(); lights] }
    }

    /// How much of light `index` the points see.
    #[inline(always)]
    pub fn view(
        &mut self,
        accelerator: &dyn Accelerator,
        points: &ShadowPoints,
        index: u32,
        area: &Area,
    ) -> View {
        let Some(corners) = area.corners(points) else { return View::Unknown };
        let (mut active, mut leaving) = (Mask::NONE, points.primitive);
        for i in 0..LANES {
            let (p, n, ng) = (lane(&points.position, i), lane(&points.n, i), lane(&points.ng, i));
            let (mut above, mut rise, mut size) = (f32::NEG_INFINITY, f32::INFINITY, 0.0);
            for corner in corners {
                let to_light = corner - p;
                above = above.max(n.dot(to_light));
                rise = rise.min(ng.dot(to_light));
                size = f32::max(size, corner.abs().max_element() + p.abs().max_element());
            }
            active.0[i] = points.hit.0[i] & -i32::from(!(above < -MARGIN * size));
            // A lifted origin may have its own facet between itself and the light.
            let own_counts = (points.lifted.0[i] != 0) & !(rise > MARGIN * size);
            leaving[i] = if own_counts { NONE } else { leaving[i] };
        }
        if !active.any() {
            return View::Dark;
        }
        let Some(skips) = self.by_light.get_mut(index as usize) else { return View::Unknown };
        if skips.next() {
            return View::Unknown;
        }
        let corners = corners.map(|corner| corner.to_array());
        let (origins, between) = (&points.origin, false);
        let shaft = Shaft { active, origins, leaving, between, corners: &corners };
        let Some(empty) = accelerator.is_shaft_empty(&shaft) else {
            self.by_light.clear();
            return View::Unknown;
        };
        skips.record(empty);
        if empty { View::Clear } else { View::Unknown }
    }
}
