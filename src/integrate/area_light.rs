//! Area lights of several points: which shadow rays are traced, and the sum of their light.

use super::adaptive_shadows::{AdaptiveShadows, LightPoint, Sum};
use super::camera_packet::CameraPacket;
use super::light_batch::{POINTS, grid};
use super::light_shafts::View;
use super::light_sums::LightSums;
use super::record::Record;
use super::render_context::RayCounts;
use super::sampled_light::SampledLight;
use super::shadows::{OWN_LANES, ShadowRays};
use super::whitted::WhittedIntegrator;
use crate::ray::{Coherence, LANES, Mask};
use crate::shading::{Area, Emitter, Lanes, Light};

impl WhittedIntegrator<'_> {
    /// Adds one area light to all lanes. Traces shadow rays to all of its points, or to the points
    /// that [`AdaptiveShadows`] selects.
    #[inline(always)]
    pub(super) fn area_light<R: Record>(
        &mut self,
        sampled_light: &SampledLight,
        area: &Area,
        camera_packet: &CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let samples = area.samples;
        let hit = self.points.at.hit;
        let mut sums = LightSums::NONE;
        // Rays near edges, and rays to a light in a surface, have tests that a shaft query does not
        // cover.
        let plain = self.crevices.is_empty() && area.plane_gap == 0.0;
        let points = &self.points.at;
        let in_clear_square = plain
            && sampled_light.bounce == 0
            && self.squares.hold(
                (self.world, self.shadows),
                (camera_packet, points, &hit),
                (sampled_light.index, &sampled_light.light.emitter),
            );
        let view = if in_clear_square {
            View::Clear
        } else if plain {
            self.shafts.view(self.shadows, points, sampled_light.index, area)
        } else {
            View::Unknown
        };
        let clear = view == View::Clear;
        if view == View::Dark {
            // No shadow ray is active.
        } else if self.world.adaptive_shadows
            && AdaptiveShadows::first(samples) < samples
            && area.map().is_none()
        {
            self.adaptive_light::<R>(
                (sampled_light, area, clear),
                camera_packet,
                counts,
                &mut sums,
            );
        } else {
            self.all_points::<R>((sampled_light, area, clear), camera_packet, counts, &mut sums);
        }
        let share = 1.0 / f64::from(samples);
        if R::ON {
            let mut split = sums.split.mean(share);
            if let Some(plate) = &self.plate {
                plate.darken(&mut split);
            }
            record.light(sampled_light, &self.points.base, &self.throughput, &split);
        }
        // Not a loop: the compiler would make vectors of axes instead of lanes.
        let [x, y, z] = &mut self.radiance;
        let ([r, g, b], carried, hit) = (&self.points.base, &self.throughput, &hit);
        add_mean(x, (&sums.light[0], share), (r, carried), hit);
        add_mean(y, (&sums.light[1], share), (g, carried), hit);
        add_mean(z, (&sums.light[2], share), (b, carried), hit);
    }

    /// Records the ambient occlusion of the first hits: the visible share of `light`, which is the
    /// hemisphere.
    #[cold]
    #[inline(never)]
    pub(super) fn occlusion<R: Record>(
        &mut self,
        light: &Light,
        camera_packet: &CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let Emitter::Area(area) = &light.emitter else { return };
        // A sample set of its own: the index after the last light.
        let index = self.world.lights.len() as u32;
        let sampled_light = SampledLight { light, index, bounce: 0, glossy: false };
        let mut sums = LightSums::NONE;
        self.all_points::<R>((&sampled_light, area, false), camera_packet, counts, &mut sums);
        record.occlusion(&sums.split.mean(1.0 / f64::from(area.samples)).visible);
    }

    /// Adds all points of an area light, in batches. If `clear`, no ray is occluded, so none is
    /// traced.
    #[inline(always)]
    pub(super) fn all_points<R: Record>(
        &mut self,
        (sampled_light, area, clear): (&SampledLight, &Area, bool),
        camera_packet: &CameraPacket,
        counts: &mut RayCounts,
        sums: &mut LightSums,
    ) {
        let (world, sampler, glossy) = (self.world, self.sampler, sampled_light.glossy);
        let mut number = [0; LANES];
        for i in 0..LANES {
            number[i] = camera_packet.sample[i].wrapping_mul(area.samples);
        }
        let source = (sampled_light.index, sampled_light.bounce);
        let squares = sampler.light_points(
            [&camera_packet.x, &camera_packet.y],
            &number,
            area.samples,
            source,
        );
        let (scene, grid) = ((&*world.geometry, self.shadows), grid(area.samples));
        let mut left = area.samples;
        while left > 0 && !self.monitor.stopped() {
            let count = POINTS.min(left as usize);
            for k in 0..count {
                let square = squares.at(&number);
                for i in 0..LANES {
                    number[i] = number[i].wrapping_add(1);
                }
                let from = &self.points.at;
                let light = (&area.points(&square, from), Some(area));
                let (rays, weights) = (&mut self.batch.rays[k], &mut self.batch.weights[k]);
                let aimed =
                    ShadowRays::aim(&self.points.at, light, world.falloff, glossy, rays, weights);
                if let Some(map) = area.map() {
                    self.batch.colors[k] = map.weigh(&self.points.at, light.0, weights);
                }
                counts.shadow += u64::from(aimed.active.count());
                self.batch.active[k] = aimed.active;
                if clear {
                    continue;
                }
                if aimed.is_plain(&self.crevices) {
                    self.batch.queue(k, &square, grid);
                } else {
                    self.batch.waiting[k] = Mask::NONE;
                    let rays = &mut self.batch.rays[k];
                    aimed.trace(scene, &self.crevices, &OWN_LANES, rays, Coherence::Coherent);
                }
            }
            if !clear {
                self.batch.trace(count, self.shadows);
            }
            for k in 0..count {
                let (active, rays) = (&self.batch.active[k], &self.batch.rays[k]);
                let mut seen = Mask::NONE;
                for i in 0..LANES {
                    seen.0[i] = active.0[i] & -i32::from(rays.tfar[i] >= 0.0);
                }
                let weights = &self.batch.weights[k];
                if area.map().is_some() {
                    sums.add_colored::<R>(
                        sampled_light.light,
                        (weights, &self.batch.colors[k]),
                        &seen,
                    );
                } else {
                    sums.add_lanes::<R>(sampled_light.light, weights, &seen);
                }
            }
            left -= count as u32;
        }
    }

    /// Adaptive shadows: [`AdaptiveShadows`] selects the points to trace, in several steps.
    #[inline(always)]
    fn adaptive_light<R: Record>(
        &mut self,
        (sampled_light, area, clear): (&SampledLight, &Area, bool),
        camera_packet: &CameraPacket,
        counts: &mut RayCounts,
        sums: &mut LightSums,
    ) {
        let sampler = self.sampler;
        let hit = self.points.at.hit;
        let mut sparing = AdaptiveShadows::new(area.samples, |lane| {
            sampler.choices(
                camera_packet.pixel(lane),
                camera_packet.sample[lane],
                sampled_light.index,
                sampled_light.bounce,
            )
        });
        let mut part = LightSums::NONE;
        loop {
            let step = sparing.clone();
            let lanes = (0..LANES).filter(|&i| hit.0[i] != 0);
            let pairs = lanes.flat_map(|lane| {
                let step = &step;
                let samples = (0..step.count()).filter_map(move |k| step.sample(lane, k));
                samples.map(move |sample| (lane, sample))
            });
            let counts = step.traced().then_some(&mut *counts);
            self.light_points(
                (sampled_light, area, clear),
                camera_packet,
                pairs,
                counts,
                |point| match sparing.take(&point) {
                    Some(Sum::Whole) => sums.add::<R>(sampled_light, &point),
                    Some(Sum::Part) => part.add::<R>(sampled_light, &point),
                    None => {}
                },
            );
            if self.monitor.stopped() || !sparing.next() {
                break;
            }
        }
        sums.add_part::<R>(&part, sparing.factor());
    }

    /// Calls `each` with the light points of the (lane, sample) pairs, in order. Leaves out points
    /// that cannot contribute. Traces 16 shadow rays per packet. If `clear`, or without `counts`,
    /// traces no ray, and all points count as visible.
    #[inline(always)]
    fn light_points(
        &mut self,
        (sampled_light, area, clear): (&SampledLight, &Area, bool),
        camera_packet: &CameraPacket,
        mut pairs: impl Iterator<Item = (usize, u32)>,
        mut counts: Option<&mut RayCounts>,
        mut each: impl FnMut(LightPoint),
    ) {
        let SampledLight { index, bounce, glossy, .. } = *sampled_light;
        loop {
            let (mut from, mut samples) = ([0; LANES], [0; LANES]);
            let (mut x, mut y, mut number) = ([0; LANES], [0; LANES], [0; LANES]);
            let mut count = 0;
            for (lane, sample) in pairs.by_ref().take(LANES) {
                [x[count], y[count]] = camera_packet.pixel(lane);
                number[count] =
                    camera_packet.sample[lane].wrapping_mul(area.samples).wrapping_add(sample);
                (from[count], samples[count]) = (lane, sample);
                count += 1;
            }
            if count == 0 || self.monitor.stopped() {
                return;
            }
            let square = self.sampler.light_lanes([&x, &y], &number, index, bounce);
            self.gathered.gather(&self.points.at, &from, count);
            let q = area.points(&square, &self.gathered);
            let (points, rays, weights) =
                (&self.gathered, &mut self.shadow, &mut self.light_weights);
            let (world, light_points) = (self.world, (&q, Some(area)));
            let aimed = ShadowRays::aim(points, light_points, world.falloff, glossy, rays, weights);
            let active = aimed.active;
            if !active.any() {
                continue;
            }
            if let Some(counts) = &mut counts {
                counts.shadow += u64::from(active.count());
                if !clear {
                    let scene = (&*world.geometry, self.shadows);
                    aimed.trace(scene, &self.crevices, &from, rays, Coherence::Coherent);
                }
            }
            for j in (0..count).filter(|&j| active.0[j] != 0) {
                each(LightPoint {
                    lane: from[j],
                    sample: samples[j],
                    visible: rays.tfar[j] >= 0.0,
                    diffuse: weights.diffuse[j],
                    specular: weights.specular[j],
                });
            }
        }
    }
}

/// Adds the mean light of one colour axis, times base colour and throughput, to the radiance of the
/// lanes that hit.
#[inline(always)]
fn add_mean(
    radiance: &mut Lanes,
    (sum, share): (&[f64; LANES], f64),
    (base, throughput): (&Lanes, &Lanes),
    hit: &Mask,
) {
    for i in 0..LANES {
        let sent = (sum[i] * share) as f32 * base[i] * throughput[i];
        radiance[i] += if hit.0[i] != 0 { sent } else { 0.0 };
    }
}
