//! The Whitted integrator for one packet: light, shadows and mirror bounces from its first hits on.
//! Implements `cast` of docs/guide/scene-format.md.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use super::clear_squares::ClearSquares;
use super::crevices::Crevices;
use super::differentials::Differentials;
use super::light_batch::LightBatch;
use super::light_shafts::LightShafts;
use super::plate::Plate;
use super::record::Record;
use super::render_context::{RayCounts, RenderContext};
use super::sampled_light::SampledLight;
use super::shadows::{OWN_LANES, ShadowRays};
use super::split::LightParts;
use crate::accel::Accelerator;
use crate::geometry::{Surfaces, refine};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayKind, Rays};
use crate::sampler::Sampler;
use crate::shading::{
    Area, Emitter, Lanes, Lanes3, LightWeights, Points, ShadowPoints, lane, reflect,
};
use crate::simd::{self, Isa, Stage};
use crate::world::World;

/// State and buffers for the shading of one packet; reused from packet to packet.
pub struct WhittedIntegrator<'a> {
    pub(super) world: &'a World,
    isa: Isa,
    /// Accelerator for all kinds of rays. Finds the primitives near a point.
    accelerator: &'a dyn Accelerator,
    /// Accelerator for camera rays.
    camera: &'a dyn Accelerator,
    /// Accelerator for shadow rays.
    pub(super) shadows: &'a dyn Accelerator,
    /// Accelerator for mirrored rays.
    reflections: &'a dyn Accelerator,
    pub(super) sampler: Sampler,
    pub(super) monitor: &'a Monitor,
    /// Light that shares the camera's sequence: see [`joint_light`](super::joint::joint_light).
    joint: Option<u32>,
    pub(super) surfaces: Surfaces,
    pub(super) crevices: Crevices,
    pub(super) shafts: LightShafts,
    pub(super) squares: ClearSquares,
    /// Lanes whose hit is not traced again if it is doubtful. Their rays start in a crevice, near
    /// an inner edge. They hit a wall, a triangle that rises beside that edge. The hit was found in
    /// f64 by [`Crevices`]; a test in f32 may miss it.
    certain: Mask,
    pub(super) points: Points,
    pub(super) shadow: Rays,
    pub(super) light_weights: LightWeights,
    pub(super) gathered: ShadowPoints,
    pub(super) batch: LightBatch,
    /// Holdouts and shadow catchers; `None` in a scene without any.
    pub(super) plate: Option<Box<Plate>>,
    /// Differentials of the rays; `None` if no texture needs them.
    differentials: Option<Box<Differentials>>,
    pub(super) throughput: [f32; LANES],
    /// Radiance of the packet's lanes: the result of [`WhittedIntegrator::shade`].
    pub radiance: Lanes3,
}

impl<'a> WhittedIntegrator<'a> {
    /// Allocates the buffers for packets of a world.
    #[inline(always)]
    pub fn new(
        RenderContext { world, accelerator, isa, monitor }: RenderContext<'a>,
        sampler: Sampler,
        joint: Option<u32>,
    ) -> Self {
        let of = |kind| accelerator.only(kind).unwrap_or(accelerator);
        let plate = || Box::new(Plate::new(world.lights.len()));
        Self {
            world,
            isa,
            accelerator,
            camera: of(RayKind::Camera),
            shadows: of(RayKind::Shadow),
            reflections: of(RayKind::Reflection),
            sampler,
            monitor,
            joint,
            surfaces: Surfaces::EMPTY,
            crevices: Crevices::default(),
            shafts: LightShafts::new(world.lights.len()),
            squares: ClearSquares::new(world),
            certain: Mask::NONE,
            points: Points::EMPTY,
            shadow: Rays::EMPTY,
            light_weights: LightWeights::EMPTY,
            gathered: ShadowPoints::EMPTY,
            batch: LightBatch::EMPTY,
            plate: world.shapes.has_roles.then(plate),
            differentials: world.shapes.has_areas.then(|| Box::new(Differentials::new(world))),
            throughput: [1.0; LANES],
            radiance: [[0.0; LANES]; 3],
        }
    }

    /// Computes `radiance` for a packet whose camera rays are traced. Returns alpha, by lane. The
    /// radiance is incomplete if the monitor stops the render.
    #[inline(always)]
    pub fn shade<R: Record>(
        &mut self,
        camera_packet: &mut CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) -> Lanes {
        simd::dispatch_stage(self.isa, self, camera_packet, counts, record)
    }

    /// Computes the surface points of a traced packet. Traces doubtful hits again. Returns the
    /// lanes that hit.
    #[inline(always)]
    fn refine(&mut self, camera_packet: &mut CameraPacket, active: &Mask, bounce: u32) -> Mask {
        let hit = camera_packet.packet.hit(active);
        if !hit.any() {
            return hit;
        }
        self.refine_hits(camera_packet, &hit);
        let doubtful = self.surfaces.doubtful.without(&self.certain);
        if doubtful.any() {
            self.retrace_doubtful(camera_packet, &doubtful, bounce);
            let hit = camera_packet.packet.hit(active);
            self.refine_hits(camera_packet, &hit);
            return hit;
        }
        hit
    }

    #[inline(always)]
    fn refine_hits(&mut self, camera_packet: &mut CameraPacket, hit: &Mask) {
        let geometry = &self.world.geometry;
        geometry.replace_stitch_hits(hit, &mut camera_packet.packet);
        refine(geometry, hit, &camera_packet.packet, &mut self.surfaces);
    }

    /// Traces the lanes with doubtful hits again.
    #[cold]
    #[inline(never)]
    fn retrace_doubtful(&mut self, camera_packet: &mut CameraPacket, doubtful: &Mask, bounce: u32) {
        for i in (0..LANES).filter(|&i| doubtful.0[i] != 0) {
            // Camera rays and mirrored rays have no end.
            camera_packet.packet.rays.tfar[i] = f32::INFINITY;
            camera_packet.packet.hits.geom[i] = NONE;
        }
        let accelerator = if bounce == 0 { self.camera } else { self.reflections };
        accelerator.closest(doubtful, &mut camera_packet.packet, Coherence::Incoherent);
    }

    /// Finds the walls beside points near an edge, if a secondary ray may start there.
    #[inline(always)]
    fn find_crevices(&mut self, camera_packet: &mut CameraPacket, hit: &Mask, bounce: u32) {
        self.crevices.clear();
        let world = self.world;
        let mut at_edge = Mask::NONE;
        for i in 0..LANES {
            at_edge.0[i] = hit.0[i] & self.surfaces.at_edge.0[i];
        }
        if at_edge.any()
            && (!world.lights.is_empty() || world.occlusion.is_some() || bounce < world.nbounces)
        {
            let (scene, packet) = ((&*world.geometry, self.accelerator), &mut camera_packet.packet);
            let kind = if bounce == 0 { RayKind::Camera } else { RayKind::Reflection };
            self.crevices.find(scene, kind, packet, &mut self.surfaces, &at_edge);
        }
    }

    /// Traces the mirrored rays of the last shading points. Returns the lanes that have one.
    #[inline(always)]
    fn mirror(&mut self, camera_packet: &mut CameraPacket, counts: &mut RayCounts) -> Mask {
        let rays = &mut camera_packet.packet.rays;
        let active = reflect(&self.points, &self.surfaces.outside, rays);
        if active.any() {
            if let Some(differentials) = &mut self.differentials {
                differentials.reflect(&self.points.at.n);
            }
            for i in 0..LANES {
                self.throughput[i] *= self.points.kr[i];
            }
            counts.reflection += u64::from(active.count());
            let coherence = coherence(&active, rays);
            camera_packet.packet.clear_hits();
            let mut rest = active;
            if !self.crevices.is_empty() {
                let geometry = &self.world.geometry;
                let packet = &mut camera_packet.packet;
                let (done, certain) =
                    self.crevices.closest(geometry, self.reflections, &active, packet);
                (rest, self.certain) = (active.without(&done), certain);
            } else {
                self.certain = Mask::NONE;
            }
            self.reflections.closest_unfiltered(&rest, &mut camera_packet.packet, coherence);
        }
        active
    }

    /// Adds the light of all lights. With a light tree, each shading point draws some of the lights
    /// that have a position.
    #[inline(always)]
    fn lights<R: Record>(
        &mut self,
        camera_packet: &CameraPacket,
        (bounce, catching): (u32, bool),
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let at = &self.points.at;
        let glossy = (0..LANES).fold(false, |any, i| any | ((at.hit.0[i] != 0) & (at.ks[i] > 0.0)));
        let world = self.world;
        // The alpha of a shadow catcher is a quotient of sums over all lights. Its mean over draws
        // of lights would be biased.
        let tree = world.light_tree.as_ref().filter(|_| !catching);
        let count = tree.map_or(world.lights.len(), |tree| tree.distant.len());
        for number in 0..count {
            let index = tree.map_or(number, |tree| tree.distant[number] as usize);
            let light = &world.lights[index];
            let sampled_light = SampledLight { light, index: index as u32, bounce, glossy };
            match &light.emitter {
                Emitter::Point(q) => {
                    let q = q.to_array().map(|x| [x; LANES]);
                    self.one_point(&sampled_light, (&q, None), camera_packet, counts, record);
                    if catching {
                        self.catch_point(&sampled_light, &q, None);
                    }
                }
                Emitter::Area(area) if area.samples == 1 => {
                    let square = if bounce == 0 && self.joint == Some(sampled_light.index) {
                        camera_packet.spare
                    } else {
                        let pixels = [&camera_packet.x, &camera_packet.y];
                        self.sampler.light_lanes(
                            pixels,
                            &camera_packet.sample,
                            sampled_light.index,
                            bounce,
                        )
                    };
                    let q = area.points(&square, &self.points.at);
                    self.one_point(&sampled_light, (&q, Some(area)), camera_packet, counts, record);
                    if catching {
                        self.catch_point(&sampled_light, &q, Some(area));
                    }
                }
                Emitter::Area(area) => {
                    self.area_light(&sampled_light, area, camera_packet, counts, record);
                    if catching {
                        self.catch_area(&sampled_light, area, camera_packet);
                    }
                }
            }
        }
        if let Some(tree) = tree {
            self.drawn_lights(tree, camera_packet, (bounce, glossy), counts, record);
        }
    }

    /// Adds the light of one light point per lane, `q`. `area` is the light's area; `None` for a
    /// point light.
    #[inline(always)]
    fn one_point<R: Record>(
        &mut self,
        sampled_light: &SampledLight,
        (q, area): (&Lanes3, Option<&Area>),
        camera_packet: &CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let light = sampled_light.light;
        let (points, rays, weights) = (&self.points.at, &mut self.shadow, &mut self.light_weights);
        let (world, glossy) = (self.world, sampled_light.glossy);
        let aimed = ShadowRays::aim(points, (q, area), world.falloff, glossy, rays, weights);
        let active = aimed.active;
        if !active.any() {
            return;
        }
        let colors = aimed.colors(points, q, weights);
        counts.shadow += u64::from(active.count());
        let is_clear = sampled_light.bounce == 0
            && aimed.is_plain(&self.crevices)
            && self.squares.hold(
                (world, self.shadows),
                (camera_packet, points, &active),
                (sampled_light.index, &light.emitter),
            );
        if !is_clear {
            let scene = (&*world.geometry, self.shadows);
            aimed.trace(scene, &self.crevices, &OWN_LANES, rays, Coherence::Coherent);
        }
        let (diffuse, specular) = (light.diffuse.to_array(), light.specular.to_array());
        if R::ON {
            let mut seen = Mask::NONE;
            for i in 0..LANES {
                seen.0[i] = active.0[i] & -i32::from(rays.tfar[i] >= 0.0);
            }
            let mut split = LightParts::from_weights(light, weights, &seen);
            if let Some(colors) = &colors {
                split.color(colors);
            }
            if let Some(plate) = &self.plate {
                plate.darken(&mut split);
            }
            let (base, throughput) = (&self.points.base, &self.throughput);
            record.light(sampled_light, base, throughput, &split);
        }
        if let Some(colors) = &colors {
            for axis in 0..3 {
                for i in 0..LANES {
                    let visible = (active.0[i] != 0) & (rays.tfar[i] >= 0.0);
                    let light =
                        weights.diffuse[i] * diffuse[axis] + weights.specular[i] * specular[axis];
                    let sent = light * colors[axis][i];
                    let sent = sent * self.points.base[axis][i] * self.throughput[i];
                    self.radiance[axis][i] += if visible { sent } else { 0.0 };
                }
            }
            return;
        }
        for axis in 0..3 {
            for i in 0..LANES {
                let visible = (active.0[i] != 0) & (rays.tfar[i] >= 0.0);
                let light =
                    weights.diffuse[i] * diffuse[axis] + weights.specular[i] * specular[axis];
                let sent = light * self.points.base[axis][i] * self.throughput[i];
                self.radiance[axis][i] += if visible { sent } else { 0.0 };
            }
        }
    }

    /// Adds ka * ambient * base * throughput to the radiance of the lanes that hit.
    #[inline(always)]
    fn ambient<R: Record>(&mut self, hit: &Mask, bounce: u32, record: &mut R) {
        let color = self.world.ambient;
        let ([r, g, b], ka, throughput) = (&self.points.base, &self.points.ka, &self.throughput);
        // Not a loop: the compiler would make vectors of axes instead of lanes.
        let sent = [
            ambient_sent(color.x, (ka, r, throughput), hit),
            ambient_sent(color.y, (ka, g, throughput), hit),
            ambient_sent(color.z, (ka, b, throughput), hit),
        ];
        for axis in 0..3 {
            for i in 0..LANES {
                self.radiance[axis][i] += sent[axis][i];
            }
        }
        if R::ON && self.world.ambient != Vec3::ZERO {
            record.ambient(bounce, &sent);
        }
    }
}

/// Most of the renderer's code: a stage that the kernels of tiles and of passes share.
impl<R: Record> Stage<CameraPacket, RayCounts, R> for WhittedIntegrator<'_> {
    type Output = Lanes;

    #[inline(always)]
    fn run(
        &mut self,
        camera_packet: &mut CameraPacket,
        counts: &mut RayCounts,
        record: &mut R,
    ) -> Lanes {
        let world = self.world;
        let mut active = camera_packet.active;
        let mut first_hit = Mask::NONE;
        self.throughput = [1.0; LANES];
        self.radiance = [[0.0; LANES]; 3];
        self.certain = Mask::NONE;
        if let Some(plate) = &mut self.plate {
            plate.clear();
        }
        if let Some(differentials) = &mut self.differentials {
            differentials.start(world, camera_packet);
        }
        for bounce in 0..=world.nbounces {
            if bounce > 0 {
                if self.monitor.stopped() {
                    break;
                }
                active = self.mirror(camera_packet, counts);
                if !active.any() {
                    break;
                }
            }
            let mut hit = self.refine(camera_packet, &active, bounce);
            if bounce == 0 {
                first_hit = hit;
            }
            if !(bounce == 0 && world.transparent) {
                self.background(camera_packet, (&active, &hit), bounce, record);
            }
            if !hit.any() {
                break;
            }
            self.find_crevices(camera_packet, &hit, bounce);
            if bounce == 0 && self.plate.is_some() {
                hit = self.split_off_holdouts(camera_packet, &hit);
            }
            let points = &mut self.points;
            if let Some(differentials) = &mut self.differentials {
                differentials.advance(&camera_packet.packet.rays, &self.surfaces);
            }
            let areas = self.differentials.as_ref().map(|all| &all.positions);
            world.shapes.look(
                &world.geometry,
                &camera_packet.packet,
                &self.surfaces,
                areas,
                points,
            );
            let catching = self.plate.as_ref().is_some_and(|plate| plate.catching);
            if catching {
                self.blacken_catchers();
            }
            if R::ON && bounce == 0 {
                record.surface(world, &camera_packet.packet, &self.surfaces, &self.points);
                if let Some(light) = &world.occlusion {
                    self.occlusion(light, camera_packet, counts, record);
                }
            }
            if world.ambient != Vec3::ZERO {
                self.ambient(&hit, bounce, record);
            }
            if catching {
                self.whiten_catchers();
            }
            self.lights(camera_packet, (bounce, catching), counts, record);
            if catching {
                self.expect_light(camera_packet);
                self.finish_catchers(record);
            }
        }
        let mut alpha = alpha(&first_hit, world.transparent);
        if let Some(plate) = &self.plate {
            plate.set_alpha(&mut alpha);
        }
        alpha
    }
}

/// Ambient light of one colour axis in the lanes that hit; 0 in the others.
#[inline(always)]
fn ambient_sent(color: f32, (ka, base, throughput): (&Lanes, &Lanes, &Lanes), hit: &Mask) -> Lanes {
    let mut sent = [0.0; LANES];
    for i in 0..LANES {
        let carried = ka[i] * color * base[i] * throughput[i];
        sent[i] = if hit.0[i] != 0 { carried } else { 0.0 };
    }
    sent
}

/// Whether mirrored rays are coherent: all within some 26 degrees of the first active ray.
#[inline(always)]
fn coherence(active: &Mask, rays: &Rays) -> Coherence {
    let axis = lane(&rays.dir, active.first());
    let together = (0..LANES)
        .fold(true, |all, i| all & ((active.0[i] == 0) | (lane(&rays.dir, i).dot(axis) > 0.9)));
    if together { Coherence::Coherent } else { Coherence::Incoherent }
}

/// Alpha of camera rays: 0 where a ray misses, if the picture is transparent; else 1.
#[inline(always)]
fn alpha(hit: &Mask, transparent: bool) -> [f32; LANES] {
    let mut alpha = [1.0; LANES];
    for i in 0..LANES {
        alpha[i] = if transparent && hit.0[i] == 0 { 0.0 } else { 1.0 };
    }
    alpha
}
