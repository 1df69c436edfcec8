//! A packet of camera rays: which pixel and sample each lane stands for.

use std::ops::Range;

use super::quarters;
use crate::ray::{LANES, Mask, NONE, RayPacket};
use crate::sampler::Sampler;
use crate::shading::{Lanes, set_lane};
use crate::world::World;

/// How the 16 lanes of a packet cover pixels and samples.
#[derive(Debug, Clone, Copy)]
pub struct Pattern {
    /// Size of the block in pixels: width, height.
    pub block: [u32; 2],
    /// Samples per pixel in one packet.
    pub samples: u32,
    /// Column of the lane's pixel within the block.
    pub x: [u32; LANES],
    /// Row of the lane's pixel within the block.
    pub y: [u32; LANES],
    /// Index of the lane's pixel within the block.
    pub pixel: [usize; LANES],
    /// Sample index within the packet, by lane. The lower half of the lanes has the even samples,
    /// the upper half the odd ones, and so on within each half. So sums over lanes fold by halves
    /// in the order of [`crate::film::SampleSums`].
    sample: [u32; LANES],
    /// Lanes sorted by pixel, then by sample.
    pub order: [usize; LANES],
}

impl Pattern {
    /// The pattern for a render of `spp` samples per pixel.
    pub fn for_spp(spp: u32) -> Self {
        let (block, samples): (_, u32) = match spp {
            0..4 => ([4, 4], 1),
            4..16 => ([2, 2], 4),
            _ => ([1, 1], 16),
        };
        let pixels = LANES / samples as usize;
        let pixel: [usize; LANES] = std::array::from_fn(|i| i % pixels);
        // Bit-reversed sample index, in the bits that `samples` needs.
        let reversed = |i: u32| i.reverse_bits().checked_shr(32 - samples.ilog2()).unwrap_or(0);
        let sample: [u32; LANES] = std::array::from_fn(|i| reversed((i / pixels) as u32));
        let mut order: [usize; LANES] = std::array::from_fn(|i| i);
        order.sort_by_key(|&i| (pixel[i], sample[i]));
        Self {
            block,
            samples,
            x: pixel.map(|p| p as u32 % block[0]),
            y: pixel.map(|p| p as u32 / block[0]),
            pixel,
            sample,
            order,
        }
    }

    /// Sample index of each lane, in a packet whose first sample is `first`.
    #[inline(always)]
    pub fn numbers(&self, first: u32) -> [u32; LANES] {
        let mut numbers = [0; LANES];
        for i in 0..LANES {
            numbers[i] = first + self.sample[i];
        }
        numbers
    }

    /// Number of pixels of the block at `corner` that lie left of and above `packet_end`. `corner`
    /// must, too.
    #[inline(always)]
    pub fn within(&self, packet_end: [u32; 2], corner: [u32; 2]) -> u32 {
        let [width, height] = [0, 1].map(|k| self.block[k].min(packet_end[k] - corner[k]));
        width * height
    }

    /// Number of pixels in a block.
    #[inline(always)]
    pub fn pixels(&self) -> usize {
        (self.block[0] * self.block[1]) as usize
    }
}

/// A packet between its camera rays and its pixels.
#[derive(Clone)]
pub struct CameraPacket {
    /// The camera rays and their hits.
    pub packet: RayPacket,
    /// Lanes whose pixel and sample are part of the render.
    pub active: Mask,
    /// Column of the lane's pixel in the camera's frame; negative left of the frame, as two's
    /// complement.
    pub x: [u32; LANES],
    /// Row of the lane's pixel in the camera's frame; negative above the frame, as two's
    /// complement.
    pub y: [u32; LANES],
    /// Index of the lane's camera sample. In packets of [`Quarters`](quarters::Quarters), and
    /// with `in_order`, all lanes have `first` if nothing but the shared light reads it.
    pub sample: [u32; LANES],
    /// Top left pixel of the block, in the window's coordinates.
    pub corner: [u32; 2],
    /// First sample of the packet. For a packet of [`Quarters`](quarters::Quarters): the first
    /// sample that the packet at this place would have without reordering.
    pub first: u32,
    /// Whether this is a packet of [`Quarters`](quarters::Quarters).
    pub quarter: bool,
    /// Whether the samples come in the order of the sequence: see
    /// [`Quarters::any_order`](quarters::Quarters::any_order).
    pub in_order: bool,
    /// Points in the unit square, stratified together with the pixel offsets. The caller of
    /// [`CameraPacket::aim`] may use them for a light.
    pub spare: [Lanes; 2],
}

impl CameraPacket {
    /// A packet without rays.
    pub const EMPTY: Self = Self {
        packet: RayPacket::EMPTY,
        active: Mask::NONE,
        x: [0; LANES],
        y: [0; LANES],
        sample: [0; LANES],
        corner: [0; 2],
        first: 0,
        quarter: false,
        in_order: false,
        spare: [[0.0; LANES]; 2],
    };

    /// Pixel of lane `i` in the camera's frame.
    #[inline(always)]
    pub fn pixel(&self, i: usize) -> [u32; 2] {
        [self.x[i], self.y[i]]
    }

    /// Creates the camera rays of the block at `corner` and returns how many are active. The caller
    /// sets `sample`, `first` and `quarter` before. A lane is active if its `sample` is in
    /// `samples` and its pixel lies left of and above `packet_end`, `[width, height]`. With
    /// `spare`, also draws [`CameraPacket::spare`], unless a lens uses these dimensions.
    #[inline(always)]
    pub fn aim(
        &mut self,
        world: &World,
        sampler: &Sampler,
        pattern: &Pattern,
        (corner, [width, height]): ([u32; 2], [u32; 2]),
        samples: &Range<u32>,
        spare: bool,
    ) -> u32 {
        self.corner = corner;
        let mut count = 0;
        for i in 0..LANES {
            let (x, y) = (corner[0] + pattern.x[i], corner[1] + pattern.y[i]);
            let sample = self.sample[i];
            self.x[i] = x.wrapping_sub(world.overscan);
            self.y[i] = y.wrapping_sub(world.overscan);
            let taken = (sample >= samples.start) & (sample < samples.end);
            let active = (x < width) & (y < height) & taken;
            self.active.0[i] = -i32::from(active);
            count += u32::from(active);
        }
        self.packet.clear_hits();
        self.packet.rays.tnear = [0.0; LANES];
        self.packet.rays.tfar = [f32::INFINITY; LANES];
        self.packet.rays.leaving = [NONE; LANES];
        let (antialiased, lens) = (world.spp > 1, world.camera.has_lens());
        let pixels = [&self.x, &self.y];
        let [x, y, s, t] = if self.quarter {
            quarters::points(sampler, self.pixel(0), self.first)
        } else if self.in_order {
            quarters::points_in_order(sampler, self.pixel(0), self.first)
        } else if lens || spare {
            sampler.camera_lanes(pixels, &self.sample)
        } else if antialiased {
            let [x, y] = sampler.camera_lanes(pixels, &self.sample);
            [x, y, [0.5; LANES], [0.5; LANES]]
        } else {
            [[0.5; LANES]; 4]
        };
        self.spare = [s, t];
        let (mut px, mut py) = ([0.5; LANES], [0.5; LANES]);
        if antialiased {
            (px, py) = (x, y);
        }
        for i in 0..LANES {
            px[i] += self.x[i] as i32 as f32;
            py[i] += self.y[i] as i32 as f32;
        }
        if lens {
            for i in 0..LANES {
                let (origin, direction) = world.camera.ray(px[i], py[i], [s[i], t[i]]);
                set_lane(&mut self.packet.rays.org, i, origin);
                set_lane(&mut self.packet.rays.dir, i, direction);
            }
            return count;
        }
        if let Some(projection) = world.camera.general_projection() {
            projection.aim(&px, &py, &mut self.packet.rays);
            return count;
        }
        for i in 0..LANES {
            let (origin, direction) = world.camera.pinhole_ray(px[i], py[i]);
            set_lane(&mut self.packet.rays.org, i, origin);
            set_lane(&mut self.packet.rays.dir, i, direction);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_use_every_lane_once() {
        for spp in [1, 4, 7, 16, 100] {
            let pattern = Pattern::for_spp(spp);
            let lane = |i: usize| [pattern.x[i], pattern.y[i], pattern.sample[i]];
            let mut seen: Vec<_> = (0..LANES).map(lane).collect();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), LANES);
            assert_eq!(pattern.pixels() * pattern.samples as usize, 16);
            assert_eq!(lane(15), [pattern.block[0] - 1, pattern.block[1] - 1, pattern.samples - 1]);
            let ordered = pattern.order.map(|i| (pattern.pixel[i], pattern.sample[i]));
            let expected = |k: usize| (k / pattern.samples as usize, k as u32 % pattern.samples);
            assert_eq!(ordered, std::array::from_fn(expected));
            // Samples 2k and 2k + 1 lie half a packet apart.
            for k in (0..LANES).step_by(2).filter(|_| pattern.samples > 1) {
                assert_eq!(pattern.order[k] + LANES / 2, pattern.order[k + 1]);
            }
        }
    }
}
