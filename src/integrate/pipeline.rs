//! Camera packets one after the other, two of them under way at a time.

use std::ops::Range;

use crate::geometry::{prefetch_indices, prefetch_vertices};
use crate::ray::{Coherence, LANES};
use crate::sampler::Sampler;

use super::cast::Cast;
use super::joint::joint_light;
use super::quarters::Quarters;
use super::slot::{Pattern, Slot};
use super::{Integrator, RayCounts};

/// What becomes of a packet whose camera rays are traced.
pub trait Finish {
    /// Whether the samples of a pixel may come in the order of [`Quarters`].
    const ANY_ORDER: bool;

    /// Shades it and adds it to its pixels. Packets come in the order of their units.
    fn finish(
        &mut self,
        slot: &mut Slot,
        pattern: &Pattern,
        cast: &mut Cast,
        counts: &mut RayCounts,
    );
}

/// Traces packet k, finishes packet k - 1, and so on: while one packet is traced, the memory that the
/// other needs for shading is on its way. A unit is a block's corner and its packet's first sample. Lanes are
/// active left of and above `limit`.
#[inline(always)]
pub fn pipeline<F: Finish>(
    integrator: Integrator,
    pattern: &Pattern,
    samples: &Range<u32>,
    limit: [u32; 2],
    units: impl Iterator<Item = ([u32; 2], u32)>,
    work: &mut F,
) -> RayCounts {
    let Integrator { world, accelerator, monitor } = integrator;
    let sampler = Sampler::of(world.sampler, world.seed);
    let mut counts = RayCounts::default();
    let joint = joint_light(world);
    let mut cast = Cast::new(world, accelerator, sampler, monitor, joint);
    let by_quarters = F::ANY_ORDER && pattern.samples as usize == LANES;
    let mut quarters = Quarters::new(world);
    let [even, odd] = &mut [Slot::EMPTY; 2];
    let (mut slot, mut before) = (even, odd);
    for (traced, unit) in units.map(Some).chain([None]).enumerate() {
        if let Some(unit) = unit {
            let (corner, first) = unit;
            slot.first = first;
            slot.quarter = by_quarters && quarters.has(first, samples);
            slot.sample = if slot.quarter {
                let pixel = corner.map(|x| x.wrapping_sub(world.margin));
                quarters.samples(&sampler, pixel, first)
            } else {
                pattern.numbers(first)
            };
            let rays =
                slot.aim(world, &sampler, pattern, (corner, limit), samples, joint.is_some());
            counts.primary += u64::from(rays);
            prefetch_vertices(&world.geometry, &before.packet, LANES / 2..LANES);
            let (active, packet) = (&slot.active, &mut slot.packet);
            accelerator.closest_candidates(active, packet, Coherence::Coherent);
            prefetch_indices(&world.geometry, &slot.packet);
        }
        if traced > 0 {
            work.finish(before, pattern, &mut cast, &mut counts);
        }
        // Half of the lines now, half after the next aim: all at once are more than a core waits for.
        prefetch_vertices(&world.geometry, &slot.packet, 0..LANES / 2);
        std::mem::swap(&mut slot, &mut before);
        if monitor.stopped() {
            break;
        }
    }
    counts
}
