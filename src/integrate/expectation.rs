//! The expected light of shadow catchers without shadows: the denominator of their alpha.
//!
//! The mean of N / M over samples is E(N) / E(M) only if M is nearly constant, or if its noise
//! neither depends on N nor matters. The own points of a light serve only if their terms are nearly
//! equal, because N comes from the same points. Otherwise M is the mean over further points, which
//! cost no rays. They are doubled twice until no term stands out. Each lane decides for itself: its
//! light must not depend on which other samples share the packet.

use super::camera_packet::CameraPacket;
use super::sampled_light::SampledLight;
use super::shadows::ShadowRays;
use super::whitted::WhittedIntegrator;
use crate::math::luminance;
use crate::ray::{LANES, Mask};
use crate::shading::{Area, Emitter, Lanes3, lane};

/// Fewest own points of a light that can show how much its terms differ.
const MIN_OWN_POINTS: u32 = 4;

/// Numbers of further points.
const STEPS: [u32; 4] = [16, 64, 256, MAX_POINTS];
const MAX_POINTS: u32 = 1024;

/// Largest range of the terms, relative to their sum, for which the own points serve. It bounds the
/// relative bias of a quotient whose numerator comes from the same points.
const OWN_RANGE: f64 = 0.02;

/// Largest range of the terms, relative to their sum, for which further points suffice. It bounds
/// the squared relative error of their mean, which is the bias of a quotient.
const FURTHER_RANGE: f64 = 0.05;

/// Bounce in the keys of further points. No shading point has it, so they are independent of all
/// own points.
const FURTHER: u32 = i32::MAX as u32;

/// Luminances that light points send to each lane without shadows. Negative ones take light away.
struct Terms {
    count: u32,
    sum: [f64; LANES],
    least: [f64; LANES],
    most: [f64; LANES],
}

impl Terms {
    const NONE: Self = Self {
        count: 0,
        sum: [0.0; LANES],
        least: [f64::INFINITY; LANES],
        most: [f64::NEG_INFINITY; LANES],
    };

    fn add(&mut self, term: &[f64; LANES]) {
        self.count += 1;
        for i in 0..LANES {
            self.sum[i] += term[i];
        }
        self.widen(term);
    }

    /// Takes a term into the range, but not into the sum.
    fn widen(&mut self, term: &[f64; LANES]) {
        for i in 0..LANES {
            self.least[i] = self.least[i].min(term[i]);
            self.most[i] = self.most[i].max(term[i]);
        }
    }

    /// Mean of a lane, or the share of `count` own points of mean `own` among all points, if that
    /// is more: they found what these missed, and alpha needs a bound.
    fn mean(&self, lane: usize, own: f64, count: u32) -> f64 {
        // A render that was stopped may have no terms.
        let mean = self.sum[lane] / f64::from(self.count.max(1));
        let all = f64::from(count) + f64::from(self.count);
        let found = own * f64::from(count) / all;
        let is_more = found * mean >= 0.0 && found.abs() > mean.abs();
        if is_more { found } else { mean }
    }

    /// Whether the range of a lane's terms is at most `limit` of their sum. `others` is the light
    /// of other lights: a range is as important as its share of all light.
    fn are_even(&self, lane: usize, limit: f64, others: f64) -> bool {
        let sum = self.sum[lane] + f64::from(self.count) * others;
        self.most[lane] - self.least[lane] <= limit * sum.abs()
    }
}

impl WhittedIntegrator<'_> {
    /// Sets the expected light of catchers after the last light. Only shadows make alpha other than
    /// 0, so without any there is nothing to do.
    #[cold]
    #[inline(never)]
    pub(super) fn expect_light(&mut self, camera_packet: &CameraPacket) {
        let Some(plate) = &mut self.plate else { return };
        let mut shadowed = Mask::NONE;
        for i in (0..LANES).filter(|&i| plate.catchers.0[i] != 0) {
            shadowed.0[i] = -i32::from(plate.arrived[i] != plate.unshadowed[i]);
        }
        plate.expected = plate.unshadowed;
        if !shadowed.any() {
            return;
        }
        let (world, unshadowed) = (self.world, plate.unshadowed);
        let glossy = (0..LANES).any(|i| shadowed.0[i] != 0 && self.points.at.ks[i] > 0.0);
        for (index, light) in (0..).zip(&world.lights) {
            let Emitter::Area(area) = &light.emitter else { continue };
            let Some(plate) = &self.plate else { return };
            let own = plate.whole[index as usize];
            let sampled_light = SampledLight { light, index, bounce: 0, glossy };
            let others = std::array::from_fn(|i| unshadowed[i] - own[i]);
            let mean =
                self.expected(&sampled_light, area, (&own, &others, &shadowed), camera_packet);
            let Some(plate) = &mut self.plate else { return };
            for i in (0..LANES).filter(|&i| shadowed.0[i] != 0) {
                plate.expected[i] += mean[i] - own[i];
            }
        }
    }

    /// Expected luminance of an area light without shadows in `lanes`. It is `own`, the mean of
    /// the light's own points, where that serves. `others` is the luminance of all other lights.
    fn expected(
        &mut self,
        sampled_light: &SampledLight,
        area: &Area,
        (own, others, lanes): (&[f64; LANES], &[f64; LANES], &Mask),
        camera_packet: &CameraPacket,
    ) -> [f64; LANES] {
        let (mut expected, mut open) = (*own, *lanes);
        let brightest = area.brightest(&self.points.at);
        let brightest = brightest.map(|q| self.term(sampled_light, area, &q));
        let (sampler, pixels) = (self.sampler, [&camera_packet.x, &camera_packet.y]);
        let count = area.samples;
        if count >= MIN_OWN_POINTS {
            let mut terms = Terms::NONE;
            brightest.iter().for_each(|term| terms.widen(term));
            let mut number = camera_packet.sample.map(|sample| sample.wrapping_mul(count));
            let source = (sampled_light.index, sampled_light.bounce);
            let squares = sampler.light_points(pixels, &number, count, source);
            for _ in 0..count {
                let q = area.points(&squares.at(&number), &self.points.at);
                terms.add(&self.term(sampled_light, area, &q));
                number = number.map(|number: u32| number.wrapping_add(1));
            }
            for i in (0..LANES).filter(|&i| terms.are_even(i, OWN_RANGE, others[i])) {
                open.0[i] = 0;
            }
            if !open.any() {
                return expected;
            }
        }
        let mut terms = Terms::NONE;
        brightest.iter().for_each(|term| terms.widen(term));
        terms.widen(own);
        let mut number = camera_packet.sample.map(|sample| sample.wrapping_mul(MAX_POINTS));
        let source = (sampled_light.index, FURTHER);
        let squares = sampler.light_points(pixels, &number, MAX_POINTS, source);
        for step in STEPS {
            while terms.count < step && !self.monitor.stopped() {
                let q = area.points(&squares.at(&number), &self.points.at);
                terms.add(&self.term(sampled_light, area, &q));
                number = number.map(|number: u32| number.wrapping_add(1));
            }
            let last = step == MAX_POINTS || self.monitor.stopped();
            for i in 0..LANES {
                if open.0[i] != 0 && (last || terms.are_even(i, FURTHER_RANGE, others[i])) {
                    expected[i] = terms.mean(i, own[i], count);
                    open.0[i] = 0;
                }
            }
            if !open.any() {
                break;
            }
        }
        expected
    }

    /// Luminance that the light points `q` send to each lane without shadows.
    fn term(&mut self, sampled_light: &SampledLight, area: &Area, q: &Lanes3) -> [f64; LANES] {
        let (points, rays, weights) = (&self.points.at, &mut self.shadow, &mut self.light_weights);
        let (falloff, light) = (self.world.falloff, sampled_light.light);
        let aimed =
            ShadowRays::aim(points, (q, Some(area)), falloff, sampled_light.glossy, rays, weights);
        let colors = aimed.colors(points, q, weights);
        let [diffuse, specular] = [light.diffuse, light.specular].map(|c| luminance(c.to_array()));
        let mut term = [0.0; LANES];
        for i in (0..LANES).filter(|&i| aimed.active.0[i] != 0) {
            let weights = [weights.diffuse[i], weights.specular[i]];
            term[i] = match &colors {
                None => diffuse * f64::from(weights[0]) + specular * f64::from(weights[1]),
                Some(colors) => {
                    let sent = light.diffuse * weights[0] + light.specular * weights[1];
                    luminance((sent * lane(colors, i)).to_array())
                }
            };
        }
        term
    }
}
