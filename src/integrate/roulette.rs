//! Shadow rays where they are needed: a part of a packet's light points first, and the others only where
//! these disagree, or by chance.
//!
//! If all of the first points are seen, the packet most likely lies in full light. The others then count as seen,
//! and one point of the light is drawn for each shading point, with a probability in proportion to what it brings.
//! Where a drawn point is hidden, all are traced, and what is hidden is taken away, divided by the probability P with
//! which it was found out: that at least one lane draws a hidden point. It is known then, as all visibilities are.
//! If none of the first points is seen, one of the others is drawn, evenly, and what is seen is added, divided by
//! that probability.
//!
//! The mean over the draws is what tracing all points gives, for any scene. In full light it is between black and full
//! light: P is no less than the share of a lane's light that is hidden, so no more is taken away than there is.
//! Diffuse and specular light have a draw each, which makes that true for every colour. In the umbra no more is added
//! than all points would bring if each were as bright as the mean of those that are seen.

use crate::ray::LANES;
use crate::scene::FIRST_SHADOW_POINTS;

/// The first points are this part of all, but no fewer than [`FIRST_SHADOW_POINTS`].
const PART: u32 = 4;

/// A light point at one shading point.
#[derive(Debug, Clone, Copy)]
pub struct LightPoint {
    /// Lane of the shading point.
    pub lane: usize,
    /// Number of the light's point.
    pub sample: u32,
    /// Not hidden, or not traced.
    pub visible: bool,
    /// As in [`crate::shading::Lit`].
    pub diffuse: f32,
    /// The same.
    pub specular: f32,
}

/// Where the light of a point belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sum {
    /// To the sum that counts in full.
    Whole,
    /// To the sum that counts by [`Sparing::factor`].
    Part,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    First,
    Rest,
    Unoccluded,
    Draw,
    Refine,
}

/// A point drawn from many with probabilities in proportion to their weights, which come one by one.
#[derive(Debug, Clone, Copy, Default)]
struct Draw {
    total: f64,
    sample: u32,
    /// Uniform in [0, 1) and independent of what is drawn so far.
    uniform: f64,
}

impl Draw {
    #[inline(always)]
    fn offer(&mut self, sample: u32, weight: f64) {
        if weight <= 0.0 {
            return;
        }
        self.total += weight;
        let share = weight / self.total;
        if self.uniform < share {
            (self.sample, self.uniform) = (sample, self.uniform / share);
        } else {
            self.uniform = (self.uniform - share) / (1.0 - share);
        }
    }
}

/// The points of a light for one packet, step by step.
#[derive(Debug, Clone)]
pub struct Sparing {
    points: u32,
    first: u32,
    step: Step,
    /// Rays of the first points, and those that reached the light.
    active: u32,
    seen: u32,
    /// Whether a drawn point says otherwise than the first ones.
    found: bool,
    /// By lane: for diffuse light, for specular light.
    draws: [[Draw; 2]; LANES],
    /// The weights of what was found otherwise.
    others: [[f64; 2]; LANES],
}

impl Sparing {
    /// Points of a light that are always traced.
    #[inline(always)]
    pub fn first(points: u32) -> u32 {
        points.div_ceil(PART).max(FIRST_SHADOW_POINTS).min(points)
    }

    /// The first step. `uniform`: two independent numbers in [0, 1) for each lane.
    #[inline(always)]
    pub fn new(points: u32, uniform: impl Fn(usize) -> [f64; 2]) -> Self {
        let mut draws = [[Draw::default(); 2]; LANES];
        for (lane, draws) in draws.iter_mut().enumerate() {
            for (draw, uniform) in draws.iter_mut().zip(uniform(lane)) {
                draw.uniform = uniform;
            }
        }
        Self {
            points,
            first: Self::first(points),
            step: Step::First,
            active: 0,
            seen: 0,
            found: false,
            draws,
            others: [[0.0; 2]; LANES],
        }
    }

    /// Whether this step's points are traced; if not, all are seen.
    #[inline(always)]
    pub fn traced(&self) -> bool {
        self.step != Step::Unoccluded
    }

    /// How many points of each lane this step has at most.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        match self.step {
            Step::First => self.first,
            Step::Draw => 2,
            Step::Rest | Step::Unoccluded | Step::Refine => self.points - self.first,
        }
    }

    /// Point `k` of this step, below [`Self::count`], in a lane.
    #[inline(always)]
    pub fn sample(&self, lane: usize, k: u32) -> Option<u32> {
        match self.step {
            Step::First => Some(k),
            Step::Draw if self.dark() => {
                let rest = self.points - self.first;
                let at = (self.draws[lane][0].uniform * f64::from(rest)) as u32;
                (k == 0).then_some(self.first + at.min(rest - 1))
            }
            Step::Draw => {
                let [diffuse, specular] = self.draws[lane];
                let sample = if k == 0 { diffuse.sample } else { specular.sample };
                // The first points are known, and one ray is enough for both.
                let twice = k == 1 && sample == diffuse.sample;
                (sample >= self.first && !twice).then_some(sample)
            }
            Step::Rest | Step::Unoccluded | Step::Refine => Some(self.first + k),
        }
    }

    /// None of the first points was seen.
    #[inline(always)]
    fn dark(&self) -> bool {
        self.seen == 0
    }

    /// Takes a point of this step; returns where its light belongs.
    #[inline(always)]
    pub fn take(&mut self, point: &LightPoint) -> Option<Sum> {
        let LightPoint { lane, sample, visible, .. } = *point;
        // Without diffuse light every point is as good.
        let diffuse = if point.diffuse > 0.0 { f64::from(point.diffuse) } else { 1.0 };
        let weights = [diffuse, f64::from(point.specular)];
        match self.step {
            Step::First | Step::Unoccluded => {
                for (draw, weight) in self.draws[lane].iter_mut().zip(weights) {
                    draw.offer(sample, weight);
                }
                if self.step == Step::First {
                    self.active += 1;
                    self.seen += u32::from(visible);
                }
                visible.then_some(Sum::Whole)
            }
            Step::Rest => visible.then_some(Sum::Whole),
            Step::Draw => {
                self.found |= visible == self.dark();
                None
            }
            Step::Refine if visible == self.dark() => {
                let weights = if self.dark() { [1.0; 2] } else { weights };
                for (other, weight) in self.others[lane].iter_mut().zip(weights) {
                    *other += weight;
                }
                Some(Sum::Part)
            }
            Step::Refine => None,
        }
    }

    /// Goes on to the next step; whether there is one.
    #[inline(always)]
    pub fn next(&mut self) -> bool {
        self.step = match self.step {
            Step::First if self.dark() => Step::Draw,
            Step::First if self.seen < self.active => Step::Rest,
            Step::First => Step::Unoccluded,
            Step::Unoccluded => Step::Draw,
            Step::Draw if self.found => Step::Refine,
            Step::Draw | Step::Rest | Step::Refine => return false,
        };
        true
    }

    /// What [`Sum::Part`] is multiplied by, after the last step: 1 over the probability of tracing all points,
    /// negative where their light counts as seen already.
    #[inline(always)]
    pub fn factor(&self) -> f64 {
        let mut chance = 0.0;
        for (draws, others) in self.draws.iter().zip(&self.others) {
            let rest = f64::from(self.points - self.first);
            for (draw, other) in draws.iter().zip(others).take(if self.dark() { 1 } else { 2 }) {
                let total = if self.dark() { rest } else { draw.total };
                let share = if total > 0.0 { other / total } else { 0.0 };
                chance += (1.0 - chance) * share.min(1.0);
            }
        }
        match (chance > 0.0, self.dark()) {
            (false, _) => 0.0,
            (true, true) => 1.0 / chance,
            (true, false) => -1.0 / chance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::Sampler;

    /// Diffuse and specular weight of a point in a lane.
    fn weights(lane: usize, sample: u32, gloss: bool) -> [f32; 2] {
        let at = (lane as u32 * 7 + sample * 5) % 11;
        let diffuse = if lane == 1 { 0.0 } else { 0.5 + at as f32 / 11.0 };
        [diffuse, if gloss && at < 2 { 40.0 } else { 0.0 }]
    }

    /// Diffuse and specular light and visible points of lanes 0 and 1, if `uniform` decides.
    fn light(
        uniform: [[f64; 2]; 2],
        points: u32,
        gloss: bool,
        visible: &dyn Fn(usize, u32) -> bool,
    ) -> [[f64; 3]; 2] {
        let mut sparing = Sparing::new(points, |lane| *uniform.get(lane).unwrap_or(&[0.5; 2]));
        let (mut whole, mut part) = ([[0.0; 3]; 2], [[0.0; 3]; 2]);
        loop {
            for lane in 0..2 {
                for sample in
                    (0..sparing.count()).filter_map(|k| sparing.sample(lane, k)).collect::<Vec<_>>()
                {
                    let [diffuse, specular] = weights(lane, sample, gloss);
                    let visible = !sparing.traced() || visible(lane, sample);
                    let point = LightPoint { lane, sample, visible, diffuse, specular };
                    let sum = match sparing.take(&point) {
                        Some(Sum::Whole) => &mut whole,
                        Some(Sum::Part) => &mut part,
                        None => continue,
                    };
                    for (sum, value) in sum[lane].iter_mut().zip([diffuse, specular, 1.0]) {
                        *sum += f64::from(value);
                    }
                }
            }
            if !sparing.next() {
                break;
            }
        }
        let factor = sparing.factor();
        [0, 1].map(|lane| [0, 1, 2].map(|k| whole[lane][k] + factor * part[lane][k]))
    }

    #[test]
    fn the_mean_over_the_draws_is_what_tracing_gives_and_none_is_negative() {
        // Full light with something hidden, umbra with something seen, and first points that disagree.
        let few = |lane: usize, sample: u32| sample % 5 == 4 + lane as u32 * 7;
        let cases: [&dyn Fn(usize, u32) -> bool; 5] = [
            &move |lane, sample| !few(lane, sample),
            &move |_, sample| sample < 4,
            &move |lane, sample| few(lane, sample) && sample > 4,
            &|_, sample| sample != 9,
            &|_, sample| sample % 2 == 0,
        ];
        let (points, draws, sampler) = (12, 50_000, Sampler::new(1));
        for (case, visible) in cases.into_iter().enumerate() {
            for gloss in [false, true] {
                // Of lanes and quantities: sum, sum of squares.
                let mut sums = [[[0.0; 2]; 3]; 2];
                for draw in 0..draws {
                    let uniform = [0, 1].map(|lane| sampler.choices([lane, 0], draw, 0, 0));
                    let found = light(uniform, points, gloss, visible);
                    for (sum, &value) in sums.iter_mut().flatten().zip(found.iter().flatten()) {
                        *sum = [sum[0] + value, sum[1] + value * value];
                    }
                    let mut lights = found.iter().flat_map(|lane| &lane[..2]);
                    assert!(lights.all(|&light| light > -1e-12), "{case}: {found:?}");
                }
                for (lane, k) in (0..2).flat_map(|lane| (0..3).map(move |k| (lane, k))) {
                    let seen = (0..points).filter(|&sample| visible(lane, sample));
                    let truth = seen.map(|sample| {
                        let [d, s] = weights(lane, sample, gloss);
                        f64::from([d, s, 1.0][k])
                    });
                    let [sum, squares] = sums[lane][k].map(|sum| sum / f64::from(draws));
                    let error = ((squares - sum * sum).max(0.0) / f64::from(draws)).sqrt();
                    let off = sum - truth.sum::<f64>();
                    let close = off.abs() <= 4.0 * error + 1e-6;
                    assert!(close, "{case} {gloss} {lane} {k}: {off} for {error}");
                }
            }
        }
    }

    #[test]
    fn points_are_drawn_in_proportion_to_their_weights() {
        let mut counts = [0u32; 4];
        for i in 0..1000 {
            let mut draw = Draw { uniform: (f64::from(i) + 0.5) / 1000.0, ..Draw::default() };
            for (sample, weight) in [(0, 1.0), (1, 0.0), (2, 5.0), (3, 2.0)] {
                draw.offer(sample, weight);
            }
            counts[draw.sample as usize] += 1;
        }
        assert_eq!(counts, [125, 0, 625, 250]);
    }

    #[test]
    fn few_points_are_all_first() {
        assert_eq!([1, 4, 8, 64].map(Sparing::first), [1, 4, 4, 16]);
    }
}
