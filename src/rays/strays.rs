//! Hits on grazing faces at a limit of their ray.
//!
//! Rounding moves a hit in space by little. Along the ray it moves it farther, the more the face is
//! slanted. So t of the rounded ray may lie on the other side of a limit than t in f64, and farther
//! from it than the tree's segment is widened. From one t to the other the face is near the ray. So
//! it is near the point of the ray at the limit. There these hits are looked for.

use std::ops::Range;

use super::further::Unanswered;
use super::rounded::{Rounded, Rounding};
use super::scene::RayScene;
use crate::accel::bvh::{Bvh, Crossing};
use crate::error::Result;
use crate::ray::{LANES, Mask, Rays};

/// The rays of a packet whose limits are looked at: at tnear, at tfar.
pub(super) type AtLimits = [Mask; 2];

impl Rounding<'_> {
    /// The rays among `lanes` that have a limit, at either end. `first` is the first ray of the
    /// packet.
    pub fn at_limits(&self, first: usize, lanes: &Mask) -> AtLimits {
        let (mut start, mut end) = (Mask::NONE, Mask::NONE);
        for i in (0..LANES).filter(|&i| lanes.0[i] != 0) {
            let (tnear, tfar) = self.rays().limits(first + i);
            start.0[i] = -i32::from(tnear > 0.0);
            end.0[i] = -i32::from(tfar < f64::INFINITY);
        }
        [start, end]
    }
}

impl RayScene {
    /// Appends the hits of rays that are far from a limit on the rounded ray, but whose faces are
    /// near the limit. `rays` end at their widened limits. Appends hits that are within these, too.
    /// May append a hit twice. Sorts `found` by lane. If `touches`, edges and vertices belong to
    /// all their faces.
    pub(super) fn strays(
        &self,
        bvh: &Bvh,
        rays: &Rays,
        lanes: &AtLimits,
        touches: bool,
        found: &mut Vec<Crossing>,
    ) {
        let slack = self.rounding_slack() as f32;
        for (is_end, lanes) in [false, true].into_iter().zip(lanes) {
            let mut around = rays.clone();
            for i in 0..LANES {
                // The ends are widened by `slack`: see `Rounding::round`.
                let end = if is_end { rays.tfar[i] } else { rays.tnear[i] + 2.0 * slack };
                around.tnear[i] = (end - 2.0 * slack).max(0.0);
                around.tfar[i] = end;
            }
            let lanes = around.possible(lanes);
            if lanes.any() {
                bvh.strays(&lanes, &around, (slack, touches), found);
            }
        }
        found.sort_unstable_by_key(|crossing| crossing.lane);
    }

    /// Leaves the rays of `range` that have strays, without a last hit: so all their hits are
    /// computed. `left` are rays in ascending order. `is_answered` tells of a ray, given by its
    /// index, whether it needs no search at tnear, and whether it needs none at tfar.
    ///
    /// # Errors
    /// The errors of [`Rounding::round`].
    pub(super) fn leave_strays(
        &self,
        rounding: &Rounding,
        range: Range<usize>,
        left: &mut Vec<Unanswered>,
        is_answered: impl Fn(usize) -> [bool; 2],
    ) -> Result<()> {
        // Embree does not tell all hits.
        let Ok(bvh) = self.bvh() else { return Ok(()) };
        let (mut rounded, mut found) = (Rounded::EMPTY, Vec::new());
        let mut strays: Vec<usize> = Vec::new();
        for first in range.step_by(LANES) {
            rounding.round(first, &mut rounded)?;
            let mut lanes = rounding.at_limits(first, &rounded.limited);
            for i in 0..LANES {
                if rounded.limited.0[i] != 0 {
                    for (lanes, answered) in lanes.iter_mut().zip(is_answered(first + i)) {
                        lanes.0[i] &= -i32::from(!answered);
                    }
                }
            }
            found.clear();
            self.strays(&bvh, &rounded.packet.rays, &lanes, true, &mut found);
            strays.extend(found.iter().map(|crossing| first + crossing.lane as usize));
        }
        if !strays.is_empty() {
            strays.dedup();
            left.retain(|ray| strays.binary_search(&ray.ray).is_err());
            left.extend(strays.into_iter().map(|ray| Unanswered { ray, last: None }));
            left.sort_unstable_by_key(|ray| ray.ray);
        }
        Ok(())
    }
}
