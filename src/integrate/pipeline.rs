//! Traces and shades camera packets, with two packets in flight.

use std::ops::Range;

use crate::geometry::{prefetch_indices, prefetch_vertices};
use crate::ray::{Coherence, LANES};
use crate::sampler::Sampler;

use super::camera_packet::{CameraPacket, Pattern};
use super::joint::joint_light;
use super::quarters::Quarters;
use super::render_context::{RayCounts, RenderContext};
use super::sights::Sight;
use super::whitted::WhittedIntegrator;

/// Shades the packets whose camera rays are traced.
pub trait ShadePacket {
    /// Whether the samples of a pixel may come in the order of [`Quarters`].
    const ANY_ORDER: bool;

    /// Shades a packet and adds it to its pixels. Packets come in the order of their units.
    fn finish(
        &mut self,
        camera_packet: &mut CameraPacket,
        pattern: &Pattern,
        integrator: &mut WhittedIntegrator,
        counts: &mut RayCounts,
    );
}

/// A block of pixels.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// Its top left pixel.
    pub corner: [u32; 2],
    /// What its camera rays can hit.
    pub sight: Sight,
}

/// Traces and finishes the packets of all units: traces packet k, then finishes packet k - 1. While
/// one packet is traced, prefetches load the memory that shading of the other packet needs. A unit
/// is a block and the first sample of a packet. Lanes are active left of and above `packet_end`.
/// Returns early if the monitor stops the render.
#[inline(always)]
pub fn pipeline<'b, F: ShadePacket>(
    context: RenderContext,
    pattern: &Pattern,
    samples: &Range<u32>,
    packet_end: [u32; 2],
    units: impl Iterator<Item = (&'b Block, u32)>,
    work: &mut F,
) -> RayCounts {
    let RenderContext { world, accelerator, monitor, .. } = context;
    let sampler = Sampler::with_kind(world.sampler, world.seed);
    let mut counts = RayCounts::default();
    let joint = joint_light(world);
    let mut integrator = WhittedIntegrator::new(context, sampler, joint);
    let by_quarters = F::ANY_ORDER && pattern.samples as usize == LANES;
    let mut quarters = Quarters::new(world);
    let [even, odd] = &mut [CameraPacket::EMPTY; 2];
    let (mut camera_packet, mut before) = (even, odd);
    for (traced, unit) in units.map(Some).chain([None]).enumerate() {
        if let Some(unit) = unit {
            let (&Block { corner, ref sight }, first) = unit;
            camera_packet.first = first;
            camera_packet.quarter = by_quarters && quarters.has(first, samples);
            camera_packet.in_order =
                by_quarters && !camera_packet.quarter && quarters.any_order(first, samples);
            camera_packet.sample = if camera_packet.in_order {
                [first; LANES]
            } else if camera_packet.quarter {
                let pixel = corner.map(|x| x.wrapping_sub(world.overscan));
                quarters.samples(&sampler, pixel, first)
            } else {
                pattern.numbers(first)
            };
            let rays = camera_packet.aim(
                world,
                &sampler,
                pattern,
                (corner, packet_end),
                samples,
                joint.is_some(),
            );
            counts.primary += u64::from(rays);
            prefetch_vertices(&world.geometry, &before.packet, LANES / 2..LANES);
            let (active, packet) = (&camera_packet.active, &mut camera_packet.packet);
            match sight {
                Sight::Background => {}
                Sight::Sole(triangle) => triangle.hit(active, packet),
                Sight::Any => accelerator.closest_unfiltered(active, packet, Coherence::Coherent),
            }
            prefetch_indices(&world.geometry, &camera_packet.packet);
        }
        if traced > 0 {
            work.finish(before, pattern, &mut integrator, &mut counts);
        }
        // Half of the cache lines now, half after the next aim: all at once exceed the misses that
        // a core can have outstanding.
        prefetch_vertices(&world.geometry, &camera_packet.packet, 0..LANES / 2);
        std::mem::swap(&mut camera_packet, &mut before);
        if monitor.stopped() {
            break;
        }
    }
    counts
}
