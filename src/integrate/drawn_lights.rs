//! Computes the light from many lights: each shading point draws some of them from the
//! [`LightTree`], and one point on each.
//!
//! The light from a drawn light is divided by its probability and by the number of draws. So the
//! expected value of the sum is the light from all lights in the tree.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use super::record::Record;
use super::render_context::RayCounts;
use super::sampled_light::SampledLight;
use super::shadows::{OWN_LANES, ShadowRays};
use super::split::LightParts;
use super::whitted::WhittedIntegrator;
use crate::ray::{Coherence, LANES, Mask};
use crate::sampler::DRAWN_LIGHT;
use crate::shading::{Area, DrawnLights, Emitter, Lanes, Lanes3, Light, LightTree, lane, set_lane};
use crate::world::World;

/// Place value of random bits that follow the 24 bits of a sample point.
const BELOW_SAMPLE: f64 = 1.0 / (1 << 24) as f64;

/// One draw in each lane.
struct Draws {
    drawn: DrawnLights,
    /// 1 / (probability x number of draws).
    weight: Lanes,
    /// The point on the light.
    q: Lanes3,
}

impl Draws {
    /// The light that lane `i` drew.
    #[inline(always)]
    fn light<'w>(&self, world: &'w World, i: usize) -> &'w Light {
        &world.lights[self.drawn.light[i] as usize]
    }

    #[inline(always)]
    fn emitter<'w>(&self, world: &'w World, i: usize) -> &'w Emitter {
        &self.light(world, i).emitter
    }
}

impl<'a> WhittedIntegrator<'a> {
    /// Adds the light of the lights that are drawn from `tree`.
    #[inline(always)]
    pub(super) fn drawn_lights<R: Record>(
        &mut self,
        tree: &LightTree,
        camera_packet: &CameraPacket,
        (bounce, glossy): (u32, bool),
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let hit = self.points.at.hit;
        for k in 0..tree.samples {
            if self.monitor.stopped() {
                break;
            }
            let draws = self.draw(tree, camera_packet, k, bounce);
            // A light in a surface has its own rules for shadow rays, so it gets a round of its
            // own.
            let mut rest = draws.drawn.lanes;
            while rest.any() {
                let (lanes, area) = self.round(&draws, &rest);
                rest = rest.without(&lanes);
                self.points.at.hit = lanes;
                self.drawn_round(&draws, area, (bounce, glossy), counts, record);
            }
            self.points.at.hit = hit;
        }
    }

    /// Draws light `k` of every lane that hit.
    #[inline(always)]
    fn draw(&self, tree: &LightTree, camera_packet: &CameraPacket, k: u32, bounce: u32) -> Draws {
        let mut number = [0; LANES];
        for i in 0..LANES {
            number[i] = camera_packet.sample[i].wrapping_mul(tree.samples).wrapping_add(k);
        }
        let [u, s, t] =
            self.sampler.drawn_light_lanes([&camera_packet.x, &camera_packet.y], &number, bounce);
        let (points, share) = (&self.points.at, 1.0 / tree.samples as f32);
        let mut uniform = [0.0; LANES];
        for i in 0..LANES {
            // A sample point has 24 bits, too few for thousands of draws in a row.
            let [low, _] =
                self.sampler.choices(camera_packet.pixel(i), number[i], DRAWN_LIGHT, bounce);
            uniform[i] = f64::from(u[i]) + low * BELOW_SAMPLE;
        }
        let drawn = tree.draw(uniform, points);
        let mut draws = Draws { drawn, weight: [0.0; LANES], q: [[0.0; LANES]; 3] };
        for i in 0..LANES {
            if draws.drawn.lanes.0[i] == 0 {
                continue;
            }
            draws.weight[i] = share / draws.drawn.probability[i];
            let q = match &draws.emitter(self.world, i) {
                Emitter::Point(q) => *q,
                Emitter::Area(area) => area.corner + area.edge * s[i] + area.height * t[i],
            };
            set_lane(&mut draws.q, i, q);
        }
        draws
    }

    /// Selects the next lanes of `rest` to trace: the lanes of one light that lies in a surface, or
    /// of all lights that do not. Also returns the area of the light that lies in a surface.
    #[inline(always)]
    fn round(&self, draws: &Draws, rest: &Mask) -> (Mask, Option<&'a Area>) {
        let world = self.world;
        let flush = |i: usize| match draws.emitter(world, i) {
            Emitter::Area(area) if area.plane_gap > 0.0 => Some(area),
            _ => None,
        };
        let first = rest.first();
        let area = flush(first);
        let mut lanes = Mask::NONE;
        for i in (0..LANES).filter(|&i| rest.0[i] != 0) {
            let together = match area {
                Some(_) => draws.drawn.light[i] == draws.drawn.light[first],
                None => flush(i).is_none(),
            };
            lanes.0[i] = -i32::from(together);
        }
        (lanes, area)
    }

    /// Adds the drawn lights of the lanes that hit. `area` is the area of their light if it lies in
    /// a surface.
    #[inline(always)]
    fn drawn_round<R: Record>(
        &mut self,
        draws: &Draws,
        area: Option<&Area>,
        (bounce, glossy): (u32, bool),
        counts: &mut RayCounts,
        record: &mut R,
    ) {
        let world = self.world;
        let (points, rays, weights) = (&self.points.at, &mut self.shadow, &mut self.light_weights);
        let light = (&draws.q, area);
        let mut aimed = ShadowRays::aim(points, light, world.falloff, glossy, rays, weights);
        for i in 0..LANES {
            if aimed.active.0[i] == 0 {
                continue;
            }
            let mut weight = draws.weight[i];
            if area.is_none() {
                // From the point itself: the ray may start at a lifted origin.
                let to_light = lane(&draws.q, i) - lane(&points.position, i);
                weight *= emission(draws.emitter(world, i), to_light);
            }
            weights.diffuse[i] *= weight;
            weights.specular[i] *= weight;
            aimed.active.0[i] = -i32::from(weight > 0.0);
        }
        let active = aimed.active;
        if !active.any() {
            return;
        }
        counts.shadow += u64::from(active.count());
        let scene = (&*world.geometry, self.shadows);
        aimed.trace(scene, &self.crevices, &OWN_LANES, rays, Coherence::Incoherent);
        let mut seen = Mask::NONE;
        for i in (0..LANES).filter(|&i| active.0[i] != 0 && rays.tfar[i] >= 0.0) {
            seen.0[i] = -1;
            let light = draws.light(world, i);
            let sent = light.diffuse * weights.diffuse[i] + light.specular * weights.specular[i];
            for axis in 0..3 {
                let carried = self.points.base[axis][i] * self.throughput[i];
                self.radiance[axis][i] += sent[axis] * carried;
            }
        }
        if R::ON {
            self.record_drawn(draws, &seen, (bounce, glossy), record);
        }
    }

    /// Records the lanes of `seen`, light by light.
    #[inline(always)]
    fn record_drawn<R: Record>(
        &self,
        draws: &Draws,
        seen: &Mask,
        (bounce, glossy): (u32, bool),
        record: &mut R,
    ) {
        let mut rest = *seen;
        while rest.any() {
            let index = draws.drawn.light[rest.first()];
            let mut lanes = Mask::NONE;
            for i in 0..LANES {
                lanes.0[i] = rest.0[i] & -i32::from(draws.drawn.light[i] == index);
            }
            rest = rest.without(&lanes);
            let light = &self.world.lights[index as usize];
            let mut split = LightParts::from_weights(light, &self.light_weights, &lanes);
            for i in 0..LANES {
                split.visible[i] *= draws.weight[i];
            }
            let sampled_light = SampledLight { light, index, bounce, glossy };
            record.light(&sampled_light, &self.points.base, &self.throughput, &split);
        }
    }
}

/// Relative emission of a light towards a point from which it lies in the direction `to_light`: the
/// cosine for a one-sided emitter, else 1.
#[inline(always)]
fn emission(emitter: &Emitter, to_light: Vec3) -> f32 {
    match emitter {
        Emitter::Area(Area { normal: Some(normal), .. }) => {
            (-to_light.dot(*normal) * (1.0 / to_light.dot(to_light).sqrt())).max(0.0)
        }
        _ => 1.0,
    }
}
