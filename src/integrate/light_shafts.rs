//! Finds packets whose points see a whole light, or none of it, without tracing shadow rays.

use crate::accel::{Accelerator, Shaft};
use crate::ray::{LANES, Mask, NONE};
use crate::shading::{Area, ShadowPoints, lane};

/// Margin for the rounding of dot products in f32 whose signs count, relative to coordinates.
const MARGIN: f32 = 16.0 * f32::EPSILON;

/// Failed queries after which packets are skipped.
const PATIENCE: u32 = 8;

/// Most packets in a row that are skipped.
const MAX_SKIPPED: u32 = 15;

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

/// Queries of the lights' shafts. After failed queries it skips packets, so that scenes full of
/// occluders hardly pay for queries.
#[derive(Debug, Default)]
pub struct LightShafts {
    by_light: Vec<Skips>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Skips {
    /// Packets still to be skipped.
    left: u32,
    /// Failed queries, up to `PATIENCE + MAX_SKIPPED`; each successful query halves their number.
    failed: u32,
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
        if skips.left > 0 {
            skips.left -= 1;
            return View::Unknown;
        }
        let corners = corners.map(|corner| corner.to_array());
        let (origins, between) = (&points.origin, false);
        let shaft = Shaft { active, origins, leaving, between, corners: &corners };
        match accelerator.is_shaft_empty(&shaft) {
            Some(true) => {
                skips.failed /= 2;
                return View::Clear;
            }
            Some(false) => {
                skips.failed = (skips.failed + 1).min(PATIENCE + MAX_SKIPPED);
                skips.left = skips.failed.saturating_sub(PATIENCE);
            }
            None => self.by_light.clear(),
        }
        View::Unknown
    }
}
