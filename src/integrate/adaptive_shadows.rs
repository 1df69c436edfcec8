//! Adaptive shadows: traces a part of a packet's light points first. The other points are traced
//! only where the first ones disagree, or by chance.
//!
//! If all of the first points are visible, the packet most likely lies in full light. The other
//! points then count as visible. Each shading point draws points of the light, with a probability
//! proportional to their contribution. If a drawn point is hidden, all points are traced. The
//! hidden light is then subtracted, divided by the probability P of this event: that at least one
//! lane draws a hidden point. P is known at that time, because all visibilities are.
//!
//! If none of the first points is visible, each shading point draws one of the others, with uniform
//! probability. If a drawn point is visible, all are traced. The visible light is then added,
//! divided by the probability that at least one lane draws a visible point.
//!
//! The estimator is unbiased: its mean over the draws is the result of tracing all points, for any
//! scene. In full light the result is never negative. P is at least the hidden share of a lane's
//! light, so no more is subtracted than there is. Diffuse and specular light have a draw each, so
//! that this holds for every colour. In the umbra the added light has a limit: that of all other
//! points, each as bright as the mean of the visible ones.

use crate::ray::LANES;
use crate::scene::FIRST_SHADOW_POINTS;

/// One in this many points is a first point; there are at least [`FIRST_SHADOW_POINTS`].
const PART: u32 = 4;

/// A light point seen from one shading point.
#[derive(Debug, Clone, Copy)]
pub struct LightPoint {
    /// Lane of the shading point.
    pub lane: usize,
    /// Index of the point among the light's points.
    pub sample: u32,
    /// Whether nothing occludes the shadow ray. True also if it was not traced.
    pub visible: bool,
    /// Diffuse weight, as in [`crate::shading::LightWeights`].
    pub diffuse: f32,
    /// Specular weight, as in [`crate::shading::LightWeights`].
    pub specular: f32,
}

/// The sum to which the light of a point is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sum {
    /// The sum that counts in full.
    Whole,
    /// The sum that is multiplied by [`AdaptiveShadows::factor`].
    Part,
}

/// What is done with the points of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Traces the first points.
    First,
    /// Traces the others, because the first ones disagree.
    Rest,
    /// Counts the others as visible, because all first ones are.
    Unoccluded,
    /// Traces the drawn points.
    Draw,
    /// Traces the others, because a drawn one contradicts the first ones.
    Refine,
}

/// Weighted reservoir sampling: draws one point with a probability proportional to its weight. The
/// points come one by one.
#[derive(Debug, Clone, Copy, Default)]
struct Draw {
    total: f64,
    sample: u32,
    /// Uniform in [0, 1) and independent of the draws so far.
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

/// Adaptive shadows of one light for one packet: selects the points of each step.
#[derive(Debug, Clone)]
pub struct AdaptiveShadows {
    points: u32,
    first: u32,
    step: Step,
    /// Number of rays to the first points.
    active: u32,
    /// Number of these rays that are not occluded.
    seen: u32,
    /// Whether a drawn point contradicts the first ones.
    found: bool,
    /// By lane: the draw for diffuse light and the draw for specular light.
    draws: [[Draw; 2]; LANES],
    /// Sums of the weights of the points that contradict the first ones, by lane and draw.
    others: [[f64; 2]; LANES],
}

impl AdaptiveShadows {
    /// Number of points of a light that are always traced.
    #[inline(always)]
    pub fn first(points: u32) -> u32 {
        points.div_ceil(PART).max(FIRST_SHADOW_POINTS).min(points)
    }

    /// Starts at the first step. `uniform` returns two independent numbers in [0, 1) for each lane.
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

    /// Whether this step's points are traced; if not, all count as visible.
    #[inline(always)]
    pub fn traced(&self) -> bool {
        self.step != Step::Unoccluded
    }

    /// Largest number of points that this step has in a lane.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        match self.step {
            Step::First => self.first,
            Step::Draw => 2,
            Step::Rest | Step::Unoccluded | Step::Refine => self.points - self.first,
        }
    }

    /// Index of light point `k` of this step in a lane, for k below [`Self::count`]. `None` if the
    /// lane has fewer points.
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
                // The first points are known already. One ray serves both draws of the same point.
                let twice = k == 1 && sample == diffuse.sample;
                (sample >= self.first && !twice).then_some(sample)
            }
            Step::Rest | Step::Unoccluded | Step::Refine => Some(self.first + k),
        }
    }

    /// Whether none of the first points was visible.
    #[inline(always)]
    fn dark(&self) -> bool {
        self.seen == 0
    }

    /// Takes the result of a point of this step. Returns the sum that its light belongs to, if any.
    #[inline(always)]
    pub fn take(&mut self, point: &LightPoint) -> Option<Sum> {
        let LightPoint { lane, sample, visible, .. } = *point;
        // Without diffuse light, all points have the same weight.
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

    /// Moves on to the next step. Returns false if there is none.
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

    /// Factor of [`Sum::Part`], valid after the last step: 1 over the probability of tracing all
    /// points. It is negative if their light already counts as visible.
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

    /// Diffuse light, specular light and number of visible points in lanes 0 and 1, for the given
    /// `uniform` numbers.
    fn light(
        uniform: [[f64; 2]; 2],
        points: u32,
        gloss: bool,
        visible: &dyn Fn(usize, u32) -> bool,
    ) -> [[f64; 3]; 2] {
        let mut sparing =
            AdaptiveShadows::new(points, |lane| *uniform.get(lane).unwrap_or(&[0.5; 2]));
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
    fn the_estimator_is_unbiased_and_never_negative() {
        // Full light with hidden points, umbra with visible points, and first points that disagree.
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
                // By lane and quantity: sum and sum of squares.
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
    fn a_light_of_few_points_is_always_traced_whole() {
        assert_eq!([1, 4, 8, 64].map(AdaptiveShadows::first), [1, 4, 4, 16]);
    }
}
