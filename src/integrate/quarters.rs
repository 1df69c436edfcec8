//! Reorders 64 samples of a pixel into four packets, each with the points of one quarter of a
//! light. So the shadow rays of a packet stay coherent.
//!
//! It applies to the light that shares the camera's sequence: Sobol's third and fourth dimension.
//! The first binary digit of each decides the quarter. It is a sum modulo 2 of bits of the index
//! (see the matrices in [`crate::sampler`]). With j0 as the lowest bit, these are j0, j1, j3, j4 in
//! the third dimension, and j0, j1, j4 in the fourth. Scrambling only changes which quarter is
//! which.

use std::ops::Range;

use crate::ray::LANES;
use crate::sampler::{Places, STRETCH, Sampler, SamplerKind};
use crate::shading::Lanes;
use crate::world::World;

use super::joint::joint_light;

/// Packets in a group of reordered samples.
pub const PACKETS: usize = 4;

/// Samples in a group: one stretch of the sequence.
const GROUP: u32 = STRETCH as u32;

/// Index within the group's stretch of the sequence, by packet and lane. Bits j1, j2, j4, j5 of the
/// index come from the lane, the highest first. Bit j3 is the higher bit of the packet's index. Bit
/// j0 is set so that all lanes of a packet fall into one quarter. So two packets that differ in the
/// lower bit of their indices hold pairs of neighbours in their lanes; see
/// [`super::block::BlockSums::add_quarter`].
const INDICES: [[u8; LANES]; PACKETS] = {
    let mut indices = [[0; LANES]; PACKETS];
    let mut at = 0;
    while at < PACKETS * LANES {
        let (packet, lane) = (at / LANES, at % LANES);
        let (j1, j2, j4, j5) = (lane >> 3, lane >> 2 & 1, lane >> 1 & 1, lane & 1);
        let (j0, j3) = ((packet ^ j1 ^ j4) & 1, packet >> 1);
        indices[packet][lane] = (j0 | j1 << 1 | j2 << 2 | j3 << 3 | j4 << 4 | j5 << 5) as u8;
        at += 1;
    }
    indices
};

/// Camera points of the four packets of a group.
static PLACES: [Places<LANES>; PACKETS] = {
    let [a, b, c, d] = &INDICES;
    [Places::new(a), Places::new(b), Places::new(c), Places::new(d)]
};

/// Camera points of a packet of 16 samples in the order of the sequence: lane i has the position
/// whose bits are those of i, reversed. So sums over the lanes fold as in
/// [`Pattern`](super::camera_packet::Pattern).
static SIXTEEN: Places<LANES> =
    Places::new(&[0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15]);

/// Decides which packets are reordered, and computes their samples.
pub struct Quarters {
    /// Whether groups are reordered in this render.
    on: bool,
    /// Whether anything besides the shared light needs the sample indices of lanes.
    needs_samples: bool,
    /// Sample at each index of the sequence, counted within the current group of the pixel.
    samples: [u8; STRETCH],
}

impl Quarters {
    /// For a world rendered in packets of 16 samples of one pixel.
    #[inline(always)]
    pub fn new(world: &World) -> Self {
        // The points that adaptive shadows skip depend on the packets, so nothing is reordered
        // there. A packet with a shadow catcher draws no lights.
        let by_packets =
            world.adaptive_shadows || (world.light_tree.is_some() && world.shapes.has_roles);
        let on = world.sampler == SamplerKind::Sobol && !by_packets;
        Self {
            on: on && joint_light(world).is_some(),
            // Of a shadow catcher, the light without shadows may take points of its own.
            needs_samples: world.lights.len() > 1 || world.nbounces > 0 || world.shapes.has_roles,
            samples: [0; STRETCH],
        }
    }

    /// Whether the group of the packet with first sample `first` is reordered and lies within
    /// `samples`.
    #[inline(always)]
    pub fn has(&self, first: u32, samples: &Range<u32>) -> bool {
        let group = first / GROUP * GROUP;
        self.on & (group >= samples.start) & (samples.end.saturating_sub(group) >= GROUP)
    }

    /// Whether the 16 samples from `first` on may come in the order of the sequence, because
    /// nothing but the shared light needs the sample indices of lanes.
    ///
    /// Their sum keeps its bits, because the shuffle of samples only swaps halves of the tree that
    /// sums them.
    #[inline(always)]
    pub fn any_order(&self, first: u32, samples: &Range<u32>) -> bool {
        self.on
            & !self.needs_samples
            & (first >= samples.start)
            & (samples.end.saturating_sub(first) >= LANES as u32)
    }

    /// Sample index of each lane, for the packet that would have the 16 samples from `first` on
    /// without reordering. All are `first` if nothing needs them. The packets of a group must come
    /// in order.
    #[inline(always)]
    pub fn samples(&mut self, sampler: &Sampler, pixel: [u32; 2], first: u32) -> [u32; LANES] {
        let (packet, group) = (packet(first), first / GROUP * GROUP);
        let mut samples = [first; LANES];
        if !self.needs_samples {
            return samples;
        }
        if packet == 0 {
            self.samples = sampler.camera_stretch_samples(pixel, group);
        }
        for i in 0..LANES {
            let index = usize::from(INDICES[packet][i]);
            samples[i] = group + u32::from(self.samples[index % STRETCH]);
        }
        samples
    }
}

/// Camera points of the same packet: [`Sampler::camera`] of its samples.
#[inline(always)]
pub fn points(sampler: &Sampler, pixel: [u32; 2], first: u32) -> [Lanes; 4] {
    sampler.camera_stretch(pixel, (first / GROUP * GROUP, GROUP), &PLACES[packet(first)])
}

/// Camera points of the 16 samples from `first` on, in the order of the sequence.
#[inline(always)]
pub fn points_in_order(sampler: &Sampler, pixel: [u32; 2], first: u32) -> [Lanes; 4] {
    sampler.camera_stretch(pixel, (first, LANES as u32), &SIXTEEN)
}

/// Index within its group of the packet whose first sample is `first`.
#[inline(always)]
pub fn packet(first: u32) -> usize {
    (first % GROUP) as usize / LANES
}

#[cfg(test)]
mod tests {
    use super::super::block::{BlockSums, Values};
    use super::super::camera_packet::Pattern;
    use super::*;

    fn quarters() -> Quarters {
        Quarters { on: true, needs_samples: true, samples: [0; STRETCH] }
    }

    #[test]
    fn each_packet_samples_one_quarter_of_the_light() {
        for seed in 0..20 {
            let (sampler, mut quarters) = (Sampler::new(seed), quarters());
            for group in [0, 64, 1 << 16, 12 * 64] {
                let pixel = [seed as u32 * 3, 7];
                let (mut seen, mut taken) = (Vec::new(), Vec::new());
                for packet in 0..4 {
                    let samples = quarters.samples(&sampler, pixel, group + 16 * packet);
                    let of = |sample: u32| {
                        let [_, _, s, t] = sampler.camera(pixel, sample);
                        [(s * 2.0) as u32, (t * 2.0) as u32]
                    };
                    assert!(samples.iter().all(|&sample| of(sample) == of(samples[0])));
                    let points = points(&sampler, pixel, group + 16 * packet);
                    for (i, &sample) in samples.iter().enumerate() {
                        assert_eq!(points.map(|lanes| lanes[i]), sampler.camera(pixel, sample));
                    }
                    seen.push(of(samples[0]));
                    taken.extend(samples);
                }
                seen.sort_unstable();
                assert_eq!(seen, [[0, 0], [0, 1], [1, 0], [1, 1]]);
                taken.sort_unstable();
                assert_eq!(taken, (group..group + 64).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn samples_in_the_order_of_the_sequence_keep_the_bits_of_their_sum() {
        let pattern = Pattern::for_spp(16);
        for seed in 0..20 {
            let sampler = Sampler::new(seed);
            for first in [0, 16, 48, 1 << 16, 12 * 16] {
                let pixel = [seed as u32 * 3, 7];
                let points = points_in_order(&sampler, pixel, first);
                let taken: [u32; LANES] = std::array::from_fn(|i| {
                    let found = |&sample: &u32| {
                        sampler.camera(pixel, sample) == points.map(|lanes| lanes[i])
                    };
                    (first..first + 16).find(found).expect("a sample of the packet")
                });
                let mut sorted = taken;
                sorted.sort_unstable();
                assert!(sorted.into_iter().eq(first..first + 16));
                let sums = [taken, pattern.numbers(first)].map(|numbers| {
                    let value = |sample: u32| (sample.wrapping_mul(0x9e37_79b9) as f32).sin();
                    let values = [0; 4].map(|_| Values(numbers.map(value)));
                    let mut sums = BlockSums::new(&pattern, 4, 0);
                    sums.add(&pattern, first, &(0..u32::MAX), &values, &[true; 4]);
                    sums.total(0, 0).to_bits()
                });
                assert_eq!(sums[0], sums[1], "{seed} {first}");
            }
        }
    }

    #[test]
    fn reordered_sums_keep_their_bits() {
        let pattern = Pattern::for_spp(64);
        let (sampler, mut quarters) = (Sampler::new(9), quarters());
        // The bits of the sum depend on the order of samples.
        let value = |sample: u32| {
            (sample.wrapping_mul(0x9e37_79b9) as f32) * (sample as f32 % 13.0 - 6.0).exp2()
        };
        // Four quantities, each with its own values.
        let values = |numbers: [u32; LANES]| {
            [0, 1, 2, 3].map(|q| Values(numbers.map(|sample| value(sample + 1000 * q))))
        };
        for samples in [0..64, 0..128, 3..150, 64..128] {
            let sums = [false, true].map(|grouped| {
                let mut sums = BlockSums::new(&pattern, 4, 0);
                for first in (samples.start / 16 * 16..samples.end).step_by(16) {
                    if grouped && quarters.has(first, &samples) {
                        let numbers = quarters.samples(&sampler, [5, 6], first);
                        sums.add_quarter(first, &values(numbers));
                    } else {
                        let numbers = pattern.numbers(first);
                        sums.add(&pattern, first, &samples, &values(numbers), &[true; 4]);
                    }
                }
                [0, 1, 2, 3].map(|quantity| sums.total(0, quantity).to_bits())
            });
            assert_eq!(sums[0], sums[1], "{samples:?}");
        }
    }
}
