//! Searches on behind hits that lie outside of a ray's own limits.
//!
//! The tree traces a segment that is a little longer than that from `tnear` to `tfar`, because its
//! rays and triangles are rounded. The t of a hit in f64 tells whether the hit counts. If not, the
//! search goes on behind it.

use std::mem::take;

use super::refine::{FoundHit, Refined};
use super::rounded::{Rounded, Rounding};
use super::scene::RayScene;
use crate::accel::Accelerator;
use crate::error::Result;
use crate::ray::{LANES, Mask};

/// A ray whose hit is still searched for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unanswered {
    /// Index of the ray.
    pub ray: usize,
    /// The rounded ray's parameter of the last hit, which does not count; `None` before the first.
    pub last: Option<f32>,
}

impl RayScene {
    /// Finds the first hits that count, of rays in ascending order. Calls `store` with hits, their
    /// values and the index of a hit among them that counts.
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
        let (mut rounded, mut found) = (Rounded::EMPTY, Vec::new());
        while !left.is_empty() {
            found.clear();
            for packet in left.chunk_by(|a, b| a.ray / LANES == b.ray / LANES) {
                let first = packet[0].ray / LANES * LANES;
                rounding.round(first, &mut rounded)?;
                rounded.go_on(first, packet);
                let Rounded { active, packet, coherence, .. } = &mut rounded;
                accelerator.closest(active, packet, *coherence);
                self.collect_hits(first, &rounded, &mut found);
            }
            take(&mut left);
            self.refine(rounding.rays(), &found, |hits, refined| {
                for (i, hit) in hits.iter().enumerate() {
                    if refined.counts[i] {
                        store(hits, refined, i);
                    } else {
                        left.push(Unanswered { ray: hit.ray, last: Some(hit.t) });
                    }
                }
            });
        }
        Ok(())
    }
}

impl Rounded {
    /// Keeps only these rays of the packet, whose first ray has the index `first`. They start
    /// behind their last hits.
    fn go_on(&mut self, first: usize, left: &[Unanswered]) {
        let mut kept = Mask::NONE;
        for &Unanswered { ray, last } in left {
            let lane = ray - first;
            kept.0[lane] = self.active.0[lane];
            if let Some(last) = last {
                // The next larger number: `last` is not negative.
                let behind = f32::from_bits(last.abs().to_bits() + 1);
                let start = &mut self.packet.rays.tnear[lane];
                *start = start.max(behind);
            }
        }
        self.active = self.packet.rays.possible(&kept);
    }
}
