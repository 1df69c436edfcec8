//! The light of shadow catchers. It is computed as for a white surface, once with and once without
//! shadows. Alpha is the luminance that shadows take over the expected luminance without shadows.
//! `expectation` computes the latter.

use super::camera_packet::CameraPacket;
use super::light_sums::LightSums;
use super::record::{Beauty, Record};
use super::render_context::RayCounts;
use super::sampled_light::SampledLight;
use super::shadows::ShadowRays;
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
    pub(super) fn split_off_holdouts(&mut self, camera_packet: &CameraPacket, hit: &Mask) -> Mask {
        let Some(plate) = &mut self.plate else { return *hit };
        plate.clear();
        let hits = &camera_packet.packet.hits;
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

    /// Moves the light of a light source from the radiance of catchers into their sums, after
    /// [`WhittedIntegrator::one_point`] with the same light point `q` in each lane.
    #[cold]
    #[inline(never)]
    pub(super) fn catch_point(
        &mut self,
        sampled_light: &SampledLight,
        q: &Lanes3,
        area: Option<&Area>,
    ) {
        let (rays, weights) = (&mut self.shadow, &mut self.light_weights);
        let (falloff, light) = (self.world.falloff, sampled_light.light);
        let aimed = ShadowRays::aim(
            &self.points.at,
            (q, area),
            falloff,
            sampled_light.glossy,
            rays,
            weights,
        );
        let points = &self.points.at;
        let colors = aimed.colors(points, q, weights);
        let mut whole = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in (0..LANES).filter(|&i| aimed.active.0[i] != 0) {
                whole[axis][i] = weights.diffuse[i] * light.diffuse[axis]
                    + weights.specular[i] * light.specular[axis];
                if let Some(colors) = &colors {
                    whole[axis][i] *= colors[axis][i];
                }
            }
        }
        self.catch(sampled_light, &whole);
    }

    /// [`WhittedIntegrator::catch_point`] for all points of an area light.
    #[cold]
    #[inline(never)]
    pub(super) fn catch_area(
        &mut self,
        sampled_light: &SampledLight,
        area: &Area,
        camera_packet: &CameraPacket,
    ) {
        let (mut sums, mut counts) = (LightSums::NONE, RayCounts::default());
        let lit = (sampled_light, area, true);
        self.all_points::<Beauty>(lit, camera_packet, &mut counts, &mut sums);
        let share = 1.0 / f64::from(area.samples);
        let whole = sums.light.map(|axis| axis.map(|sum| (sum * share) as f32));
        self.catch(sampled_light, &whole);
    }

    /// Moves the radiance of catchers, which is the light of `sampled_light`, into their sums.
    /// `whole` is this light without shadows, with the same rounding.
    fn catch(&mut self, sampled_light: &SampledLight, whole: &Lanes3) {
        let Some(plate) = &mut self.plate else { return };
        for i in (0..LANES).filter(|&i| plate.catchers.0[i] != 0) {
            let arrived = luminance([0, 1, 2].map(|axis| self.radiance[axis][i]));
            let unshadowed = luminance([0, 1, 2].map(|axis| whole[axis][i]));
            plate.arrived[i] += arrived;
            plate.unshadowed[i] += unshadowed;
            plate.whole[sampled_light.index as usize][i] = unshadowed;
            plate.taken[sampled_light.index as usize][i] = unshadowed - arrived;
            self.radiance.iter_mut().for_each(|axis| axis[i] = 0.0);
        }
    }

    /// Computes the alpha of catchers from their sums.
    #[cold]
    #[inline(never)]
    pub(super) fn finish_catchers<R: Record>(&mut self, record: &mut R) {
        let Some(plate) = &mut self.plate else { return };
        plate.catching = false;
        let lit = |i: usize| plate.catchers.0[i] != 0 && plate.expected[i] > 0.0;
        let lit: [bool; LANES] = std::array::from_fn(lit);
        for i in 0..LANES {
            let alpha = (plate.unshadowed[i] - plate.arrived[i]) / plate.expected[i];
            plate.alpha[i] = if lit[i] { alpha as f32 } else { 0.0 };
        }
        if R::ON {
            for (light, taken) in plate.taken.iter().enumerate() {
                let share = |i: usize| {
                    if lit[i] { (taken[i] / plate.expected[i]) as f32 } else { 0.0 }
                };
                record.caught(light, &std::array::from_fn(share));
            }
        }
    }
}
