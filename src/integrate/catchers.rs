//! The light of shadow catchers. It is computed as for a white surface, once with and once without
//! shadows. Alpha is 1 minus the quotient of the two luminances.

use super::camera_packet::CameraPacket;
use super::record::{Beauty, Record};
use super::sampled_light::SampledLight;
use super::shadows::ShadowRays;
use super::sums::Sums;
use super::whitted::WhittedIntegrator;
use crate::math::luminance;
use crate::ray::{LANES, Mask};
use crate::scene::Role;
use crate::shading::{Area, Lanes3};

impl WhittedIntegrator<'_> {
    /// Finds the holdouts and catchers that camera rays hit. Returns `hit` without the holdouts,
    /// which also lose their surface points.
    #[cold]
    #[inline(never)]
    pub(super) fn hold_out(&mut self, slot: &CameraPacket, hit: &Mask) -> Mask {
        let Some(plate) = &mut self.plate else { return *hit };
        plate.clear();
        let hits = &slot.packet.hits;
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            match self.world.shapes.role(hits.geom[i], hits.prim[i]) {
                Role::Surface => {}
                Role::Holdout => plate.holdouts.0[i] = -1,
                Role::ShadowCatcher => plate.catchers.0[i] = -1,
            }
        }
        plate.catching = plate.catchers.any();
        let rest = hit.without(&plate.holdouts);
        self.surfaces.hit = rest;
        rest
    }

    /// Makes the shading points on catchers black, without ambient light and mirror. Their sums
    /// start with the ambient light.
    #[cold]
    #[inline(never)]
    pub(super) fn blacken_catchers(&mut self) {
        let Some(plate) = &mut self.plate else { return };
        let ambient = luminance(self.world.ambient.to_array());
        for i in (0..LANES).filter(|&i| plate.catchers.0[i] != 0) {
            let ambient = f64::from(self.points.ka[i]) * ambient;
            (plate.arrived[i], plate.unshadowed[i]) = (ambient, ambient);
            (self.points.ka[i], self.points.kr[i]) = (0.0, 0.0);
            self.points.base.iter_mut().for_each(|axis| axis[i] = 0.0);
        }
    }

    /// Makes the shading points on catchers white, for the light that they receive.
    #[cold]
    #[inline(never)]
    pub(super) fn whiten_catchers(&mut self) {
        let Some(plate) = &self.plate else { return };
        for i in (0..LANES).filter(|&i| plate.catchers.0[i] != 0) {
            self.points.base.iter_mut().for_each(|axis| axis[i] = 1.0);
        }
    }

    /// Moves the light of a lamp from the radiance of catchers into their sums, after
    /// [`WhittedIntegrator::one_point`] with the same light point `q` in each lane.
    #[cold]
    #[inline(never)]
    pub(super) fn catch_point(&mut self, lamp: &SampledLight, q: &Lanes3, area: Option<&Area>) {
        let (rays, lit) = (&mut self.shadow, &mut self.lit);
        let (falloff, light) = (self.world.falloff, lamp.light);
        let aimed = ShadowRays::aim(&self.points.at, (q, area), falloff, lamp.glossy, rays, lit);
        let points = &self.points.at;
        let colors = aimed.colors(points, q, lit);
        let mut whole = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in (0..LANES).filter(|&i| aimed.active.0[i] != 0) {
                whole[axis][i] =
                    lit.diffuse[i] * light.diffuse[axis] + lit.specular[i] * light.specular[axis];
                if let Some(colors) = &colors {
                    whole[axis][i] *= colors[axis][i];
                }
            }
        }
        self.catch(lamp, &whole);
    }

    /// [`WhittedIntegrator::catch_point`] for all points of an area light.
    #[cold]
    #[inline(never)]
    pub(super) fn catch_area(&mut self, lamp: &SampledLight, area: &Area, slot: &CameraPacket) {
        let falloff = self.world.falloff;
        let mut number = [0; LANES];
        for i in 0..LANES {
            number[i] = slot.sample[i].wrapping_mul(area.samples);
        }
        let source = (lamp.index, lamp.bounce);
        let pixels = [&slot.x, &slot.y];
        let squares = self.sampler.light_points(pixels, &number, area.samples, source);
        let mut sums = Sums::NONE;
        for _ in 0..area.samples {
            if self.monitor.stopped() {
                break;
            }
            let from = &self.points.at;
            let light = (&area.points(&squares.at(&number), from), Some(area));
            number = number.map(|number: u32| number.wrapping_add(1));
            let (rays, lit) = (&mut self.shadow, &mut self.lit);
            let aimed = ShadowRays::aim(&self.points.at, light, falloff, lamp.glossy, rays, lit);
            match area.map() {
                Some(map) => {
                    let colors = map.weigh(&self.points.at, light.0, lit);
                    sums.add_colored::<Beauty>(lamp.light, (lit, &colors), &aimed.active);
                }
                None => sums.add_lanes::<Beauty>(lamp.light, lit, &aimed.active),
            }
        }
        let share = 1.0 / f64::from(area.samples);
        let whole = sums.light.map(|axis| axis.map(|sum| (sum * share) as f32));
        self.catch(lamp, &whole);
    }

    /// Moves the radiance of catchers, which is the light of `lamp`, into their sums. `whole` is
    /// this light without shadows, with the same rounding.
    fn catch(&mut self, lamp: &SampledLight, whole: &Lanes3) {
        let Some(plate) = &mut self.plate else { return };
        for i in (0..LANES).filter(|&i| plate.catchers.0[i] != 0) {
            let arrived = luminance([0, 1, 2].map(|axis| self.radiance[axis][i]));
            let unshadowed = luminance([0, 1, 2].map(|axis| whole[axis][i]));
            plate.arrived[i] += arrived;
            plate.unshadowed[i] += unshadowed;
            plate.taken[lamp.index as usize][i] = unshadowed - arrived;
            self.radiance.iter_mut().for_each(|axis| axis[i] = 0.0);
        }
    }

    /// Computes the alpha of catchers after the last lamp.
    #[cold]
    #[inline(never)]
    pub(super) fn finish_catchers<R: Record>(&mut self, record: &mut R) {
        let Some(plate) = &mut self.plate else { return };
        plate.catching = false;
        let lit = |i: usize| plate.catchers.0[i] != 0 && plate.unshadowed[i] > 0.0;
        let lit: [bool; LANES] = std::array::from_fn(lit);
        for i in 0..LANES {
            let alpha = 1.0 - plate.arrived[i] / plate.unshadowed[i];
            plate.alpha[i] = if lit[i] { alpha as f32 } else { 0.0 };
        }
        if R::ON {
            for (light, taken) in plate.taken.iter().enumerate() {
                let share = |i: usize| {
                    if lit[i] { (taken[i] / plate.unshadowed[i]) as f32 } else { 0.0 }
                };
                record.caught(light, &std::array::from_fn(share));
            }
        }
    }
}
