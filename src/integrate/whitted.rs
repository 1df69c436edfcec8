//! The Whitted integrator for one packet: light, shadows and mirror bounces from its first hits on.
//! Implements `cast` of docs/guide/scene-format.md.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use super::crevices::Crevices;
use super::light_batch::LightBatch;
use super::light_shafts::LightShafts;
use super::record::Record;
use super::render_context::RayCounts;
use super::sampled_light::SampledLight;
use super::shadows::{OWN_LANES, ShadowRays};
use super::split::LightParts;
use crate::accel::Accelerator;
use crate::geometry::{Surfaces, refine};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, Rays};
use crate::sampler::Sampler;
use crate::shading::{Area, Emitter, Lanes3, LightWeights, Points, ShadowPoints, lane, reflect};
use crate::world::World;

/// State and buffers for the shading of one packet; reused from packet to packet.
pub struct WhittedIntegrator<'a> {
    pub(super) world: &'a World,
    pub(super) accelerator: &'a dyn Accelerator,
    pub(super) sampler: Sampler,
    pub(super) monitor: &'a Monitor,
    /// Light that shares the camera's sequence: see [`joint_light`](super::joint::joint_light).
    joint: Option<u32>,
    surfaces: Surfaces,
    pub(super) crevices: Crevices,
    pub(super) shafts: LightShafts,
    /// Lanes whose hit is on a wall of [`Crevices`]: certain, although no test in f32 can confirm
    /// it.
    certain: Mask,
    pub(super) points: Points,
    pub(super) shadow: Rays,
    pub(super) lit: LightWeights,
    pub(super) gathered: ShadowPoints,
    pub(super) batch: LightBatch,
    pub(super) throughput: [f32; LANES],
    /// Radiance of the packet's lanes: the result of [`WhittedIntegrator::run`].
    pub radiance: Lanes3,
}

impl<'a> WhittedIntegrator<'a> {
    /// Allocates the buffers for packets of `world`.
    #[inline(always)]
    pub fn new(
        world: &'a World,
        accelerator: &'a dyn Accelerator,
        sampler: Sampler,
        monitor: &'a Monitor,
        joint: Option<u32>,
    ) -> Self {
        Self {
            world,
            accelerator,
            sampler,
            monitor,
            joint,
            surfaces: Surfaces::EMPTY,
            crevices: Crevices::default(),
            shafts: LightShafts::new(world.lights.len()),
            certain: Mask::NONE,
            points: Points::EMPTY,
            shadow: Rays::EMPTY,
            lit: LightWeights::EMPTY,
            gathered: ShadowPoints::EMPTY,
            batch: LightBatch::EMPTY,
            throughput: [1.0; LANES],
            radiance: [[0.0; LANES]; 3],
        }
    }

    /// Computes `radiance` for a slot whose camera rays are traced. Returns the lanes that hit.
    #[inline(always)]
    pub fn run<R: Record>(
        &mut self,
        slot: &mut CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) -> Mask {
        let world = self.world;
        let mut active = slot.active;
        let mut first_hit = Mask::NONE;
        self.throughput = [1.0; LANES];
        self.radiance = [[0.0; LANES]; 3];
        self.certain = Mask::NONE;
        for bounce in 0..=world.nbounces {
            if bounce > 0 {
                if self.monitor.stopped() {
                    break;
                }
                active = self.mirror(slot, counts);
                if !active.any() {
                    break;
                }
            }
            let hit = self.refine(slot, &active);
            if bounce == 0 {
                first_hit = hit;
            }
            if !(bounce == 0 && world.transparent) {
                self.background(&active, &hit, bounce, record);
            }
            if !hit.any() {
                break;
            }
            self.find_crevices(slot, &hit, bounce);
            let points = &mut self.points;
            world.shapes.look(&world.geometry, &slot.packet, &self.surfaces, points);
            if R::ON && bounce == 0 {
                record.surface(world, &slot.packet, &self.surfaces, &self.points);
            }
            if world.ambient != Vec3::ZERO {
                self.ambient(&hit, bounce, record);
            }
            self.lights(slot, bounce, counts, record);
        }
        first_hit
    }

    /// Computes the surface points of a traced packet. Returns the lanes that hit.
    #[inline(always)]
    fn refine(&mut self, slot: &mut CameraPacket, active: &Mask) -> Mask {
        let hit = slot.packet.hit(active);
        if !hit.any() {
            return hit;
        }
        self.refine_hits(slot, &hit);
        let doubtful = self.surfaces.doubtful.without(&self.certain);
        if doubtful.any() {
            self.retrace_doubtful(slot, &doubtful);
            let hit = slot.packet.hit(active);
            self.refine_hits(slot, &hit);
            return hit;
        }
        hit
    }

    #[inline(always)]
    fn refine_hits(&mut self, slot: &mut CameraPacket, hit: &Mask) {
        let geometry = &self.world.geometry;
        geometry.replace_stitch_hits(hit, &mut slot.packet);
        refine(geometry, hit, &slot.packet, &mut self.surfaces);
    }

    /// Traces the lanes with doubtful hits again.
    #[cold]
    #[inline(never)]
    fn retrace_doubtful(&mut self, slot: &mut CameraPacket, doubtful: &Mask) {
        for i in (0..LANES).filter(|&i| doubtful.0[i] != 0) {
            // Camera rays and mirrored rays have no end.
            slot.packet.rays.tfar[i] = f32::INFINITY;
            slot.packet.hits.geom[i] = NONE;
        }
        self.accelerator.closest(doubtful, &mut slot.packet, Coherence::Incoherent);
    }

    /// Finds the walls beside points near an edge, if any secondary ray leaves them.
    #[inline(always)]
    fn find_crevices(&mut self, slot: &mut CameraPacket, hit: &Mask, bounce: u32) {
        self.crevices.clear();
        let world = self.world;
        let mut at_edge = Mask::NONE;
        for i in 0..LANES {
            at_edge.0[i] = hit.0[i] & self.surfaces.at_edge.0[i];
        }
        if at_edge.any() && (!world.lights.is_empty() || bounce < world.nbounces) {
            let (geometry, packet) = (&world.geometry, &mut slot.packet);
            self.crevices.find(geometry, self.accelerator, packet, &mut self.surfaces, &at_edge);
        }
    }

    /// Traces the mirrored rays of the last points. Returns the lanes that have one.
    #[inline(always)]
    fn mirror(&mut self, slot: &mut CameraPacket, counts: &mut RayCounts) -> Mask {
        let rays = &mut slot.packet.rays;
        let active = reflect(&self.points, &self.surfaces.outside, rays);
        if active.any() {
            for i in 0..LANES {
                self.throughput[i] *= self.points.kr[i];
            }
            counts.reflection += u64::from(active.count());
            let coherence = coherence(&active, rays);
            slot.packet.clear_hits();
            let mut rest = active;
            if !self.crevices.is_empty() {
                let geometry = &self.world.geometry;
                let packet = &mut slot.packet;
                let (done, certain) =
                    self.crevices.closest(geometry, self.accelerator, &active, packet);
                (rest, self.certain) = (active.without(&done), certain);
            } else {
                self.certain = Mask::NONE;
            }
            self.accelerator.closest_unfiltered(&rest, &mut slot.packet, coherence);
        }
        active
    }

    #[inline(always)]
    fn lights<R: Record>(
        &mut self,
        slot: &CameraPacket,
        bounce: u32,
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let at = &self.points.at;
        let glossy = (0..LANES).fold(false, |any, i| any | ((at.hit.0[i] != 0) & (at.ks[i] > 0.0)));
        for (index, light) in self.world.lights.iter().enumerate() {
            let lamp = SampledLight { light, index: index as u32, bounce, glossy };
            match light.emitter {
                Emitter::Point(q) => {
                    let q = q.to_array().map(|x| [x; LANES]);
                    self.one_point(&lamp, &q, None, counts, record);
                }
                Emitter::Area(area) if area.samples == 1 => {
                    let square = if bounce == 0 && self.joint == Some(lamp.index) {
                        slot.spare
                    } else {
                        let pixels = [&slot.x, &slot.y];
                        self.sampler.light_lanes(pixels, &slot.sample, lamp.index, bounce)
                    };
                    self.one_point(&lamp, &area.points(&square), Some(&area), counts, record);
                }
                Emitter::Area(area) => self.area_light(&lamp, area, slot, counts, record),
            }
        }
    }

    /// Adds a light of which every lane samples one point `q`, on `area` if the light has one.
    #[inline(always)]
    fn one_point<R: Record>(
        &mut self,
        lamp: &SampledLight,
        q: &Lanes3,
        area: Option<&Area>,
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let light = lamp.light;
        let (points, rays, lit) = (&self.points.at, &mut self.shadow, &mut self.lit);
        let (world, glossy) = (self.world, lamp.glossy);
        let aimed = ShadowRays::aim(points, (q, area), world.falloff, glossy, rays, lit);
        let active = aimed.active;
        if !active.any() {
            return;
        }
        counts.shadow += u64::from(active.count());
        let scene = (&*world.geometry, self.accelerator);
        aimed.trace(scene, &self.crevices, &OWN_LANES, rays, Coherence::Coherent);
        let (diffuse, specular) = (light.diffuse.to_array(), light.specular.to_array());
        if R::ON {
            let mut seen = Mask::NONE;
            for i in 0..LANES {
                seen.0[i] = active.0[i] & -i32::from(rays.tfar[i] >= 0.0);
            }
            let split = LightParts::from_weights(light, lit, &seen);
            let (base, throughput) = (&self.points.base, &self.throughput);
            record.light(lamp, base, throughput, &split);
        }
        for axis in 0..3 {
            for i in 0..LANES {
                let visible = (active.0[i] != 0) & (rays.tfar[i] >= 0.0);
                let light = lit.diffuse[i] * diffuse[axis] + lit.specular[i] * specular[axis];
                let sent = light * self.points.base[axis][i] * self.throughput[i];
                self.radiance[axis][i] += if visible { sent } else { 0.0 };
            }
        }
    }

    /// Adds the background to the active lanes that missed.
    #[inline(always)]
    fn background<R: Record>(&mut self, active: &Mask, hit: &Mask, bounce: u32, record: &mut R) {
        if !active.without(hit).any() {
            return;
        }
        let color = self.world.background.to_array();
        let mut sent = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                let missed = (active.0[i] & !hit.0[i]) != 0;
                let carried = color[axis] * self.throughput[i];
                sent[axis][i] = if missed { carried } else { 0.0 };
                self.radiance[axis][i] += sent[axis][i];
            }
        }
        if R::ON {
            record.background(bounce, &sent);
        }
    }

    /// Adds ka * ambient * base to the lanes that hit.
    #[inline(always)]
    fn ambient<R: Record>(&mut self, hit: &Mask, bounce: u32, record: &mut R) {
        let color = self.world.ambient.to_array();
        let mut sent = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                let carried = self.points.ka[i] * color[axis] * self.points.base[axis][i];
                let carried = carried * self.throughput[i];
                sent[axis][i] = if hit.0[i] != 0 { carried } else { 0.0 };
                self.radiance[axis][i] += sent[axis][i];
            }
        }
        if R::ON && self.world.ambient != Vec3::ZERO {
            record.ambient(bounce, &sent);
        }
    }
}

/// Whether mirrored rays are coherent: all within some 26 degrees of the first.
#[inline(always)]
fn coherence(active: &Mask, rays: &Rays) -> Coherence {
    let axis = lane(&rays.dir, active.first());
    let together = (0..LANES)
        .fold(true, |all, i| all & ((active.0[i] == 0) | (lane(&rays.dir, i).dot(axis) > 0.9)));
    if together { Coherence::Coherent } else { Coherence::Incoherent }
}
