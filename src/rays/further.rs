//! Searches on where the first hit lies outside of a ray's own limits.
//!
//! The tree traces a segment that is a little longer than that from `tnear` to `tfar`, because its
//! rays and triangles are rounded. The t of a hit in f64 tells whether the hit counts. If not,
//! other hits may count that are as near but for the rounding. So all of these are computed. If
//! none counts, the search goes on behind them. A hit that counts, but is so near to a limit that
//! the error of t may decide, is treated the same way: see [`super::at_limit`].
//!
//! Grazing faces may be farther from a limit. If a ray has one there, all its hits are computed:
//! see [`super::strays`].
//!
//! Embree does not tell all hits. There the search goes on directly behind a hit that does not
//! count.

use super::at_limit::{AtLimit, MARGIN, is_near_limit};
use super::batch::RayBatch;
use super::refine::{FoundHit, Refined};
use super::rounded::{Rounded, Rounding};
use super::scene::RayScene;
use crate::accel::Accelerator;
use crate::accel::bvh::Bvh;
use crate::error::Result;
use crate::ray::{LANES, Mask};

/// About this many hits are held at once. All of one packet of rays are.
const HITS_HELD: usize = 1 << 16;

/// A ray whose hit is still searched for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unanswered {
    /// Index of the ray.
    pub ray: usize,
    /// Where the last hit is, in the rounded ray's parameter: the places by which the tree ordered
    /// it and of its t, the lesser first. There is no hit before them that counts. `None` before
    /// the first hit.
    pub last: Option<[f32; 2]>,
}

impl Unanswered {
    /// What is to be searched for hit `i` of those whose values were computed: others around it, if
    /// it does not count or if others between its two places may be nearer.
    #[inline(always)]
    pub fn around(hit: &FoundHit, refined: &Refined, i: usize) -> Option<Self> {
        let moved = refined.moved[i];
        let is_first = refined.counts[i] & moved.is_nan();
        // A NaN becomes the other number.
        let last = Some([hit.t.min(moved), hit.t.max(moved)]);
        (!is_first).then_some(Self { ray: hit.ray, last })
    }
}

impl RayScene {
    /// The fraction of t by which hits must be within the limits if all hits around them can be
    /// computed.
    pub(super) fn margin(&self) -> f64 {
        if self.bvh().is_ok() { MARGIN } else { 0.0 }
    }

    /// Finds the first hits that count, of rays in ascending order. Calls `store` with hits, their
    /// values and the index of a hit among them that counts. Of several hits of a ray, the nearest
    /// is its first.
    ///
    /// # Errors
    /// The errors of [`Rounding::round`].
    pub(super) fn search_on(
        &self,
        accelerator: &dyn Accelerator,
        rounding: &Rounding,
        mut left: Vec<Unanswered>,
        mut store: impl FnMut(&[FoundHit], &Refined, usize),
    ) -> Result<()> {
        let (bvh, margin) = (self.bvh().ok(), self.margin());
        let reach = if bvh.is_some() { 2.0 * self.rounding_slack() as f32 } else { 0.0 };
        let (mut rounded, mut found) = (Rounded::EMPTY, Vec::new());
        while !left.is_empty() {
            if let Some(bvh) = &bvh {
                self.search_around(bvh, rounding, reach, &mut left, &mut store)?;
            }
            found.clear();
            for packet in packets(&left) {
                let first = packet[0].ray / LANES * LANES;
                rounding.round(first, &mut rounded)?;
                rounded.narrow(first, packet, |[_, last]| (behind(last, reach), f32::INFINITY));
                let Rounded { active, packet, coherence, .. } = &mut rounded;
                accelerator.closest(active, packet, *coherence);
                self.collect_hits(first, &rounded, &mut found);
            }
            left.clear();
            self.refine(rounding.rays(), &found, margin, |hits, refined| {
                for (i, hit) in hits.iter().enumerate() {
                    if refined.counts[i] {
                        store(hits, refined, i);
                    }
                    left.extend(Unanswered::around(hit, refined, i));
                }
            });
        }
        Ok(())
    }

    /// Computes all hits from `reach` before the places of the last one to `reach` behind them;
    /// without a last one, all hits of the ray. Calls `store` for those that count. Removes rays
    /// that need no further search.
    fn search_around(
        &self,
        bvh: &Bvh,
        rounding: &Rounding,
        reach: f32,
        left: &mut Vec<Unanswered>,
        store: &mut impl FnMut(&[FoundHit], &Refined, usize),
    ) -> Result<()> {
        let (mut rounded, mut touches, mut found) = (Rounded::EMPTY, Vec::new(), Vec::new());
        let mut answered = Vec::new();
        for packet in packets(left) {
            let first = packet[0].ray / LANES * LANES;
            rounding.round(first, &mut rounded)?;
            // Ends do not belong to a segment.
            rounded.narrow(first, packet, |[least, most]| {
                (below((least - reach).max(0.0)), above(behind(most.max(0.0), reach)))
            });
            touches.clear();
            bvh.touches(&rounded.active, &rounded.packet.rays, &mut touches);
            let mut entire = Mask::NONE;
            for ray in packet.iter().filter(|ray| ray.last.is_none()) {
                entire.0[ray.ray - first] = rounded.active.0[ray.ray - first];
            }
            if entire.any() {
                let lanes = rounding.at_limits(first, &entire);
                self.strays(bvh, &rounded.packet.rays, &lanes, true, &mut touches);
            }
            self.collect_crossings(first, &touches, &mut found);
            if found.len() >= HITS_HELD {
                self.store_counting(rounding.rays(), &found, &mut answered, store);
                found.clear();
            }
        }
        self.store_counting(rounding.rays(), &found, &mut answered, store);
        answered.sort_unstable();
        left.retain(|ray| ray.last.is_some() && answered.binary_search(&ray.ray).is_err());
        Ok(())
    }

    /// Calls `store` for the hits that count, and appends their rays to `answered`. `found` has all
    /// hits of its rays around a limit.
    fn store_counting(
        &self,
        rays: &RayBatch,
        found: &[FoundHit],
        answered: &mut Vec<usize>,
        store: &mut impl FnMut(&[FoundHit], &Refined, usize),
    ) {
        let mut at_limit = Vec::new();
        self.refine(rays, found, 0.0, |hits, refined| {
            for (i, &hit) in hits.iter().enumerate() {
                let (t, counts) = (refined.t[i], refined.counts[i]);
                if is_near_limit(t, rays.limits(hit.ray)) {
                    at_limit.push(AtLimit { hit, t, counts });
                } else if counts {
                    store(hits, refined, i);
                    answered.push(hit.ray);
                }
            }
        });
        self.refine(rays, &self.beyond_limits(rays, &at_limit), 0.0, |hits, refined| {
            for (i, hit) in hits.iter().enumerate() {
                store(hits, refined, i);
                answered.push(hit.ray);
            }
        });
    }
}

/// The rays of each packet.
fn packets(rays: &[Unanswered]) -> impl Iterator<Item = &[Unanswered]> {
    rays.chunk_by(|a, b| a.ray / LANES == b.ray / LANES)
}

/// Where the search goes on behind a hit at `last`.
fn behind(last: f32, reach: f32) -> f32 {
    (last + reach).max(above(last))
}

/// The next smaller number of one that is not negative; 0 for 0.
fn below(t: f32) -> f32 {
    f32::from_bits(t.abs().to_bits().saturating_sub(1))
}

/// The next larger number of one that is not negative.
fn above(t: f32) -> f32 {
    f32::from_bits(t.abs().to_bits() + 1)
}

impl Rounded {
    /// Keeps only these rays of the packet, whose first ray has the index `first`. `limits` returns
    /// both ends of their segments from their last hits.
    fn narrow(
        &mut self,
        first: usize,
        left: &[Unanswered],
        limits: impl Fn([f32; 2]) -> (f32, f32),
    ) {
        let mut kept = Mask::NONE;
        for &Unanswered { ray, last } in left {
            let lane = ray - first;
            kept.0[lane] = self.active.0[lane];
            if let Some((start, end)) = last.map(&limits) {
                let (tnear, tfar) =
                    (&mut self.packet.rays.tnear[lane], &mut self.packet.rays.tfar[lane]);
                (*tnear, *tfar) = (tnear.max(start), tfar.min(end));
            }
        }
        self.active = self.packet.rays.possible(&kept);
    }
}
