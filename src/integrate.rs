//! One tile of the picture, packet by packet: camera rays, hits, light, mirrors, pixels.
//!
//! Packets sit on the frame's absolute pixel and sample grid and are traced whole, so that a crop
//! of the render is the render of the crop, whatever a backend does inside a packet.

use glam::Vec3;

use crate::accel::Accelerator;
use crate::camera::Camera;
use crate::film::Window;
use crate::geometry::{NONE, Surfaces, refine};
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use crate::sampler::Sampler;
use crate::shading::{
    Emitter, Lanes3, Light, Lit, Points, ShadowPoints, lane, light_rays, reflect, set_lane,
};
use crate::simd::Kernel;
use crate::world::World;

/// Pixels along a tile's side; a multiple of every packet's block.
pub const TILE: u32 = 32;

/// Rays traced, by class.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera.
    pub primary: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Mirror bounces.
    pub reflection: u64,
}

impl std::ops::Add for RayCounts {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            primary: self.primary + other.primary,
            shadow: self.shadow + other.shadow,
            reflection: self.reflection + other.reflection,
        }
    }
}

/// What does not change from tile to tile.
#[derive(Clone, Copy)]
pub struct Integrator<'a> {
    /// What is rendered.
    pub world: &'a World,
    /// What finds the hits.
    pub accelerator: &'a dyn Accelerator,
}

/// How the 16 lanes of a packet cover pixels and samples: the smallest piece of the picture.
#[derive(Debug, Clone, Copy)]
struct Pattern {
    /// Pixels across and down.
    block: [u32; 2],
    /// Samples of each pixel.
    samples: u32,
    /// Pixel within the block, by lane.
    x: [u32; LANES],
    /// Pixel within the block, by lane.
    y: [u32; LANES],
    /// Index of that pixel in the block, by lane.
    pixel: [usize; LANES],
    /// Sample within the packet, by lane.
    sample: [u32; LANES],
}

impl Pattern {
    fn for_spp(spp: u32) -> Self {
        let (block, samples) = match spp {
            0..4 => ([4, 4], 1),
            4..16 => ([2, 2], 4),
            _ => ([1, 1], 16),
        };
        let lane = |f: fn(u32, u32, u32) -> u32| {
            std::array::from_fn(|i| f(i as u32 / samples, block[0], i as u32 % samples))
        };
        let (x, y) = (lane(|pixel, width, _| pixel % width), lane(|pixel, width, _| pixel / width));
        Self {
            block,
            samples,
            x,
            y,
            pixel: std::array::from_fn(|i| i / samples as usize),
            sample: lane(|_, _, sample| sample),
        }
    }
}

/// Room for one packet on its way, kept between packets.
struct Scratch {
    packet: RayPacket,
    surfaces: Surfaces,
    points: Points,
    shadow: Rays,
    lit: Lit,
    gathered: ShadowPoints,
    /// Light that the packet's lanes carry.
    radiance: Lanes3,
    /// Light of one area light, before the base colour.
    sums: Lanes3,
    throughput: [f32; LANES],
    x: [u32; LANES],
    y: [u32; LANES],
    samples: [u32; LANES],
}

impl Scratch {
    /// Pixel of a lane.
    #[inline(always)]
    fn pixel(&self, i: usize) -> [u32; 2] {
        [self.x[i], self.y[i]]
    }
}

/// Rendering one tile: `rows[y][x]` are the kept pixels of the tile at `(x0, y0)`.
pub struct TileKernel<'a, 'r, 'f> {
    /// What does not change.
    pub integrator: Integrator<'a>,
    /// The kept pixels of this tile.
    pub window: Window,
    /// Their R, G, B, A.
    pub rows: &'r mut [&'f mut [[f32; 4]]],
}

impl Kernel for TileKernel<'_, '_, '_> {
    type Output = RayCounts;

    #[inline(always)]
    fn run(self) -> RayCounts {
        let mut scratch = Scratch {
            packet: RayPacket::EMPTY,
            surfaces: Surfaces::EMPTY,
            points: Points::EMPTY,
            shadow: Rays::EMPTY,
            lit: Lit::EMPTY,
            gathered: ShadowPoints::EMPTY,
            radiance: [[0.0; LANES]; 3],
            sums: [[0.0; LANES]; 3],
            throughput: [1.0; LANES],
            x: [0; LANES],
            y: [0; LANES],
            samples: [0; LANES],
        };
        let mut counts = RayCounts::default();
        let pattern = Pattern::for_spp(self.integrator.world.spp);
        let [bw, bh] = pattern.block;
        let (x0, y0) = (self.window.x0 / TILE * TILE, self.window.y0 / TILE * TILE);
        for index in 0..(TILE / bw) * (TILE / bh) {
            let [bx, by] = morton(index);
            let (x, y) = (x0 + bx * bw, y0 + by * bh);
            let w = self.window;
            if x + bw <= w.x0 || x >= w.x1 || y + bh <= w.y0 || y >= w.y1 {
                continue;
            }
            let sums = self.integrator.block(&pattern, [x, y], &mut scratch, &mut counts);
            for (pixel, sum) in sums.iter().enumerate().take((bw * bh) as usize) {
                let (px, py) = (x + pixel as u32 % bw, y + pixel as u32 / bw);
                if (w.x0..w.x1).contains(&px) && (w.y0..w.y1).contains(&py) {
                    self.rows[(py - w.y0) as usize][(px - w.x0) as usize] = *sum;
                }
            }
        }
        counts
    }
}

/// The position of an index along the Z-order curve of a tile.
#[inline(always)]
fn morton(index: u32) -> [u32; 2] {
    let even = |mut bits: u32| {
        bits &= 0x5555_5555;
        bits = (bits | (bits >> 1)) & 0x3333_3333;
        bits = (bits | (bits >> 2)) & 0x0f0f_0f0f;
        (bits | (bits >> 4)) & 0x00ff_00ff
    };
    [even(index), even(index >> 1)]
}

impl Integrator<'_> {
    /// The mean R, G, B, A of the pixels of the block at `corner`.
    #[inline(always)]
    fn block(
        &self,
        pattern: &Pattern,
        corner: [u32; 2],
        scratch: &mut Scratch,
        counts: &mut RayCounts,
    ) -> [[f32; 4]; LANES] {
        let mut sums = [[0.0f32; 4]; LANES];
        let spp = self.world.spp;
        for first in (0..spp).step_by(pattern.samples as usize) {
            let mut active = Mask::NONE;
            for i in 0..LANES {
                let (x, y) = (corner[0] + pattern.x[i], corner[1] + pattern.y[i]);
                let sample = first + pattern.sample[i];
                (scratch.x[i], scratch.y[i], scratch.samples[i]) = (x, y, sample);
                let [width, height] = self.world.frame;
                active.0[i] = -i32::from((x < width) & (y < height) & (sample < spp));
            }
            self.camera_rays(scratch);
            counts.primary += u64::from(active.count());
            let hit = self.trace(active, scratch, counts);
            for i in 0..LANES {
                if active.0[i] != 0 {
                    let alpha = if self.world.transparent && hit.0[i] == 0 { 0.0 } else { 1.0 };
                    let sum = &mut sums[pattern.pixel[i] % LANES];
                    for axis in 0..3 {
                        sum[axis] += scratch.radiance[axis][i];
                    }
                    sum[3] += alpha;
                }
            }
        }
        if spp > 1 {
            let n = spp as f32;
            sums = sums.map(|sum| sum.map(|channel| channel / n));
        }
        sums
    }

    #[inline(always)]
    fn camera_rays(&self, scratch: &mut Scratch) {
        let camera: &Camera = &self.world.camera;
        let rays = &mut scratch.packet.rays;
        rays.tnear = [0.0; LANES];
        rays.tfar = [f32::INFINITY; LANES];
        rays.leaving = [NONE; LANES];
        if self.world.spp > 1 || camera.has_lens() {
            return self.sampled_camera_rays(scratch);
        }
        for i in 0..LANES {
            let (x, y) = (scratch.x[i] as f32 + 0.5, scratch.y[i] as f32 + 0.5);
            let (origin, direction) = camera.pinhole_ray(x, y);
            set_lane(&mut rays.org, i, origin);
            set_lane(&mut rays.dir, i, direction);
        }
    }

    #[inline(never)]
    fn sampled_camera_rays(&self, scratch: &mut Scratch) {
        for i in 0..LANES {
            let [x, y, s, t] = self.sampler().camera(scratch.pixel(i), scratch.samples[i]);
            let [dx, dy] = if self.world.spp > 1 { [x, y] } else { [0.5; 2] };
            let (x, y) = (scratch.x[i] as f32 + dx, scratch.y[i] as f32 + dy);
            let (origin, direction) = self.world.camera.ray(x, y, [s, t]);
            set_lane(&mut scratch.packet.rays.org, i, origin);
            set_lane(&mut scratch.packet.rays.dir, i, direction);
        }
    }

    fn sampler(&self) -> Sampler {
        Sampler::new(self.world.seed)
    }

    /// `cast` of docs/scene-format.md for the packet's rays: fills `scratch.radiance`, returns the
    /// lanes whose first ray hit.
    #[inline(always)]
    fn trace(&self, mut active: Mask, scratch: &mut Scratch, counts: &mut RayCounts) -> Mask {
        let world = self.world;
        let mut first_hit = Mask::NONE;
        scratch.throughput = [1.0; LANES];
        scratch.radiance = [[0.0; LANES]; 3];
        for bounce in 0..=world.nbounces {
            scratch.packet.clear_hits();
            let coherence = if bounce == 0 {
                Coherence::Coherent
            } else {
                coherence(&active, &scratch.packet.rays)
            };
            self.accelerator.closest(&active, &mut scratch.packet, coherence);
            refine(&world.geometry, &active, &scratch.packet, &mut scratch.surfaces);
            let hit = scratch.surfaces.hit;
            if bounce == 0 {
                first_hit = hit;
            }
            if !(bounce == 0 && world.transparent) {
                background(world.background, &active, &hit, scratch);
            }
            if !hit.any() {
                break;
            }
            world.shapes.look(
                &world.geometry,
                &scratch.packet,
                &scratch.surfaces,
                &mut scratch.points,
            );
            if world.ambient != Vec3::ZERO {
                ambient(world.ambient, &hit, scratch);
            }
            let ks = &scratch.points.at.ks;
            let glossy = (0..LANES).fold(false, |any, i| any | ((hit.0[i] != 0) & (ks[i] > 0.0)));
            for (index, light) in world.lights.iter().enumerate() {
                match &light.emitter {
                    Emitter::Point(q) => self.point_light(light, *q, glossy, scratch, counts),
                    Emitter::Area { .. } => {
                        self.area_light(light, index as u32, bounce, glossy, scratch, counts);
                    }
                }
            }
            if bounce == world.nbounces {
                break;
            }
            active = reflect(&scratch.points, &scratch.surfaces.outside, &mut scratch.packet.rays);
            if !active.any() {
                break;
            }
            for i in 0..LANES {
                scratch.throughput[i] *= scratch.points.kr[i];
            }
            counts.reflection += u64::from(active.count());
        }
        first_hit
    }

    #[inline(always)]
    fn point_light(
        &self,
        light: &Light,
        q: Vec3,
        glossy: bool,
        scratch: &mut Scratch,
        counts: &mut RayCounts,
    ) {
        let q = q.to_array().map(|x| [x; LANES]);
        let (points, rays) = (&scratch.points.at, &mut scratch.shadow);
        let active =
            light_rays(points, &q, None, self.world.falloff, glossy, rays, &mut scratch.lit);
        counts.shadow += u64::from(active.count());
        if !active.any() {
            return;
        }
        self.accelerator.occluded(&active, rays, Coherence::Coherent);
        let (diffuse, specular) = (light.diffuse.to_array(), light.specular.to_array());
        for axis in 0..3 {
            for i in 0..LANES {
                let visible = (active.0[i] != 0) & (rays.tfar[i] >= 0.0);
                let light = scratch.lit.diffuse[i] * diffuse[axis]
                    + scratch.lit.specular[i] * specular[axis];
                let sent = light * scratch.points.base[axis][i] * scratch.throughput[i];
                scratch.radiance[axis][i] += if visible { sent } else { 0.0 };
            }
        }
    }

    /// All samples of one area light for all lanes: (lane, sample) pairs in order, 16 a packet.
    #[inline(always)]
    fn area_light(
        &self,
        light: &Light,
        index: u32,
        bounce: u32,
        glossy: bool,
        scratch: &mut Scratch,
        counts: &mut RayCounts,
    ) {
        let Emitter::Area { corner, edge, height, normal, samples } = &light.emitter else {
            return;
        };
        let hit = scratch.points.at.hit;
        let mut lanes = [0usize; LANES];
        let mut n_lanes = 0;
        for i in 0..LANES {
            if hit.0[i] != 0 {
                lanes[n_lanes] = i;
                n_lanes += 1;
            }
        }
        scratch.sums = [[0.0; LANES]; 3];
        let jobs = n_lanes as u64 * u64::from(*samples);
        let (diffuse, specular) = (light.diffuse, light.specular);
        let mut next = 0u64;
        while next < jobs {
            let count = (jobs - next).min(LANES as u64) as usize;
            let mut from = [0usize; LANES];
            let mut q = [[0.0f32; LANES]; 3];
            for j in 0..count {
                let job = next + j as u64;
                let lane = lanes[(job / u64::from(*samples)) as usize];
                let sample = (job % u64::from(*samples)) as u32;
                let all = scratch.samples[lane].wrapping_mul(*samples).wrapping_add(sample);
                let [s, t] = self.sampler().light(scratch.pixel(lane), all, index, bounce);
                from[j] = lane;
                set_lane(&mut q, j, *corner + *edge * s + *height * t);
            }
            scratch.gathered.gather(&scratch.points.at, &from, count);
            let (points, rays) = (&scratch.gathered, &mut scratch.shadow);
            let active =
                light_rays(points, &q, *normal, self.world.falloff, glossy, rays, &mut scratch.lit);
            counts.shadow += u64::from(active.count());
            if active.any() {
                self.accelerator.occluded(&active, rays, Coherence::Coherent);
            }
            for j in 0..count {
                if active.0[j] != 0 && rays.tfar[j] >= 0.0 {
                    let sum = lane(&scratch.sums, from[j]);
                    let light =
                        diffuse * scratch.lit.diffuse[j] + specular * scratch.lit.specular[j];
                    set_lane(&mut scratch.sums, from[j], sum + light);
                }
            }
            next += count as u64;
        }
        let share = 1.0 / *samples as f32;
        for axis in 0..3 {
            for i in 0..LANES {
                let sent = scratch.sums[axis][i]
                    * share
                    * scratch.points.base[axis][i]
                    * scratch.throughput[i];
                scratch.radiance[axis][i] += if hit.0[i] != 0 { sent } else { 0.0 };
            }
        }
    }
}

/// Adds the background to the active lanes that missed.
#[inline(always)]
fn background(color: Vec3, active: &Mask, hit: &Mask, scratch: &mut Scratch) {
    let color = color.to_array();
    for axis in 0..3 {
        for i in 0..LANES {
            let missed = (active.0[i] & !hit.0[i]) != 0;
            let sent = color[axis] * scratch.throughput[i];
            scratch.radiance[axis][i] += if missed { sent } else { 0.0 };
        }
    }
}

/// Adds ka * ambient * base to the lanes that hit.
#[inline(always)]
fn ambient(color: Vec3, hit: &Mask, scratch: &mut Scratch) {
    let color = color.to_array();
    for axis in 0..3 {
        for i in 0..LANES {
            let sent = scratch.points.ka[i] * color[axis] * scratch.points.base[axis][i];
            let sent = sent * scratch.throughput[i];
            scratch.radiance[axis][i] += if hit.0[i] != 0 { sent } else { 0.0 };
        }
    }
}

/// Whether mirrored rays still run much the same way: all within some 26 degrees of the first.
#[inline(always)]
fn coherence(active: &Mask, rays: &Rays) -> Coherence {
    let first = (0..LANES).find(|&i| active.0[i] != 0).unwrap_or(0);
    let axis = lane(&rays.dir, first);
    let together = (0..LANES)
        .fold(true, |all, i| all & ((active.0[i] == 0) | (lane(&rays.dir, i).dot(axis) > 0.9)));
    if together { Coherence::Coherent } else { Coherence::Incoherent }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn z_order_visits_every_block_once() {
        let mut seen = [[false; 8]; 8];
        for index in 0..64 {
            let [x, y] = morton(index);
            assert!(!std::mem::replace(&mut seen[y as usize][x as usize], true));
        }
        assert_eq!([morton(1), morton(2), morton(3)], [[1, 0], [0, 1], [1, 1]]);
    }

    #[test]
    fn patterns_use_every_lane_once() {
        for spp in [1, 4, 7, 16, 100] {
            let pattern = Pattern::for_spp(spp);
            let mut seen: Vec<_> =
                (0..LANES).map(|i| [pattern.x[i], pattern.y[i], pattern.sample[i]]).collect();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), LANES);
            assert_eq!(pattern.block[0] * pattern.block[1] * pattern.samples, 16);
            assert_eq!(seen[15], [pattern.block[0] - 1, pattern.block[1] - 1, pattern.samples - 1]);
        }
    }
}
