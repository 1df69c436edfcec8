//! Decides whether one backend's answer to one ray is right.
//!
//! - [`judge`] compares it with the oracle's answer.
//! - [`refute`] needs no oracle: it finds the wrong answers where backends disagree.
//!
//! An answer within the error bound of the backend's own test is not wrong. Bounds are multiples of
//! the bound of `bvh`'s test ([`Brute::near`]).

mod layers;
pub mod refute;

use serde::{Deserialize, Serialize};

use self::layers::layers;
use super::answer::Answer;
use crate::accel::brute::{Brute, Near, near_primitive};
use crate::accel::lane::LaneRay;
use crate::lab::named::named;

named! {
    /// Result of comparing an answer with the oracle's.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Verdict {
        /// The same primitive at the same t, within the error bound. Or both answers are misses, or
        /// both are occlusions.
        Agree = "agree",
        /// A different primitive at the same t, within the errors. The ray hits both within the
        /// error bound.
        Tie = "tie",
        /// Another answer: the ray passes an outline within the error bound.
        Edge = "edge",
        /// Not judged: the ray has more than [`MAX_NEAR`] hits and near hits within the error
        /// bound, mostly because it comes from far away.
        Crowd = "crowd",
        /// The answer misses a surface, and no error within the bound explains it.
        Leak = "leak",
        /// A hit on a primitive that the ray misses by more than the error bound.
        FalseHit = "false hit",
        /// The right t, but on a primitive that the ray misses by more than the error bound.
        WrongPrimitive = "wrong primitive",
        /// A primitive that the ray hits within the error bound, but at a wrong t.
        WrongDistance = "wrong distance",
    }
}

impl Verdict {
    /// Returns whether the answer is wrong: no error within the bound explains it.
    pub fn is_wrong(self) -> bool {
        self >= Self::Leak
    }
}

/// Largest number of hits and near hits of a ray that is judged ([`Brute::near`]). A ray from far
/// away may have more: then right and wrong answers cannot be distinguished.
pub const MAX_NEAR: usize = 1000;

/// Judges `answer` by `truth`, the oracle's answer to the same query.
///
/// `factor` is the error bound of the backend's own test, in units of the bound of `bvh`'s test:
/// [`TestedBackend::error_factor`](super::backend::TestedBackend::error_factor).
pub fn judge(oracle: &Brute, ray: &LaneRay, truth: Answer, answer: Answer, factor: f64) -> Verdict {
    match (truth, answer) {
        (Answer::Hit { geom, prim, t: exact }, Answer::Hit { geom: g, prim: p, t })
            if (geom, prim) == (g, p) && same(t, exact) =>
        {
            Verdict::Agree
        }
        (Answer::Hit { geom, prim, .. }, Answer::Hit { geom: g, prim: p, t })
            if (geom, prim) == (g, p) =>
        {
            let near = near_primitive(oracle.geometry(), ray, g, p, factor);
            let place = near.iter().any(|part| (part.t - t).abs() <= part.t_error);
            if place { Verdict::Agree } else { Verdict::WrongDistance }
        }
        (Answer::Miss, Answer::Miss) | (Answer::Occluded, Answer::Occluded) => Verdict::Agree,
        _ => match oracle.near(ray, factor, MAX_NEAR) {
            Some(near) => explain(&near, ray, truth, answer),
            None => Verdict::Crowd,
        },
    }
}

/// Returns whether `t`, an f32, is `exact` to within rounding. An infinite `t` is the rounding of
/// an `exact` beyond the range of f32.
fn same(t: f64, exact: f64) -> bool {
    (t - exact).abs() <= f64::from(f32::EPSILON) * exact.abs() || t == f64::from(exact as f32)
}

/// Judges an answer that differs from `truth`, by the primitives near the ray.
fn explain(near: &[Near], ray: &LaneRay, truth: Answer, answer: Answer) -> Verdict {
    // Whether the ray certainly hits a layer between its start and `end`.
    let passed =
        |end: f64| layers(near).iter().any(|layer| layer.near > ray.tnear && layer.far < end);
    let within =
        |part: &&Near| part.t + part.t_error > ray.tnear && part.t - part.t_error < ray.tfar;
    let at = |geom, prim, t: f64| {
        let of = move |part: &&Near| (part.geom, part.prim) == (geom, prim);
        // A quad or sphere may have two entries.
        near.iter()
            .filter(|part| of(part) && within(part))
            .min_by(|a, b| ((a.t - t).abs() - a.t_error).total_cmp(&((b.t - t).abs() - b.t_error)))
    };
    match answer {
        Answer::Miss if passed(ray.tfar) => Verdict::Leak,
        Answer::Miss => Verdict::Edge,
        Answer::Occluded if near.iter().any(|part| within(&part)) => Verdict::Edge,
        Answer::Occluded => Verdict::FalseHit,
        Answer::Hit { geom, prim, t } => {
            let exact = match truth {
                Answer::Hit { geom, prim, t } => Some((geom, prim, t)),
                _ => None,
            };
            // Rounding to f32 may move t onto an end of the segment.
            let in_segment = t >= ray.tnear && t <= ray.tfar;
            let Some(part) = at(geom, prim, t) else {
                let near_truth = exact.and_then(|(geom, prim, t)| at(geom, prim, t));
                return match near_truth {
                    Some(part) if (part.t - t).abs() <= part.t_error => Verdict::WrongPrimitive,
                    Some(part) if part.t < t && passed(t) => Verdict::Leak,
                    _ => Verdict::FalseHit,
                };
            };
            if !in_segment || !((part.t - t).abs() <= part.t_error) {
                return Verdict::WrongDistance;
            }
            if passed(part.t - part.t_error) {
                return Verdict::Leak;
            }
            match exact {
                Some((g, p, exact)) => {
                    let error = at(g, p, exact).map_or(0.0, |truth| truth.t_error);
                    let tie = (exact - t).abs() <= error + part.t_error;
                    if tie { Verdict::Tie } else { Verdict::Edge }
                }
                None => Verdict::Edge,
            }
        }
    }
}
