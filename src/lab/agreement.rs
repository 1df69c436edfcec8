//! Compares the answers of all backends to the same rays.

use serde::{Deserialize, Serialize};

use super::answer::Answer;
use super::query::answers;
use super::rays::PacketToTrace;
use super::replay::Replay;
use super::verdict::refute;
use crate::accel::Accelerator;
use crate::geometry::Geometry;
use crate::ray::{Coherence, LANES};

/// Two values of t count as the same up to this relative difference, some 84 times 2^-23. Beyond
/// it, [`refute`] tests in f64 which answer is wrong.
const SAME_T: f32 = 1e-5;

/// Numbers of rays on which two backends agree or differ, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Agreement {
    /// The same primitive at the same t, two misses, two occlusions, or two hits at infinite t.
    pub same: u64,
    /// Different primitives at the same finite t.
    pub tie: u64,
    /// Hits at different t.
    pub depth: u64,
    /// One backend reports a hit or an occlusion, the other a miss.
    pub missed: u64,
}

impl Agreement {
    /// Counts one ray. Returns true if its two answers agree or tie.
    fn add(&mut self, a: &Answer, b: &Answer) -> bool {
        // Backends report t in f32.
        let [s, t] = [a, b].map(|answer| answer.t() as f32);
        let near = (s - t).abs() <= SAME_T * s.abs().max(t.abs());
        // Both t are infinite for occlusions, and for hits beyond the range of f32.
        let (hit, no_t) = (a.is_hit(), s == f32::INFINITY && t == f32::INFINITY);
        let count = match (hit == b.is_hit(), !hit || no_t, near) {
            (false, ..) => &mut self.missed,
            (_, true, _) => &mut self.same,
            (.., false) => &mut self.depth,
            _ if a.primitive() == b.primitive() => &mut self.same,
            _ => &mut self.tie,
        };
        *count += 1;
        hit == b.is_hit() && (!hit || no_t || near)
    }

    /// Number of rays whose two answers differ by more than a tie.
    pub fn disagreements(&self) -> u64 {
        self.depth + self.missed
    }
}

/// Hits and wrong answers of one backend.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Score {
    /// Number of rays that hit something.
    pub hits: u64,
    /// Number of provably wrong answers. Only rays on which backends disagree are judged.
    pub wrong: u64,
}

/// Compares the answers of all backends to one replay, ray by ray.
///
/// Returns the score of each backend, and the agreement of every pair (i, j), i < j.
pub fn compare(
    replay: &Replay,
    geometry: &Geometry,
    backends: &[&dyn Accelerator],
) -> (Vec<Score>, Vec<(usize, usize, Agreement)>) {
    let all: Vec<Vec<[Answer; LANES]>> = backends.iter().map(|b| replay.answers(*b)).collect();
    let mut scores = vec![Score::default(); backends.len()];
    let pairs = (0..backends.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
    let mut pairs: Vec<_> = pairs.map(|(i, j)| (i, j, Agreement::default())).collect();
    for (p, packet) in replay.packets.iter().enumerate() {
        for lane in (0..LANES).filter(|&lane| packet.active.0[lane] != 0) {
            let said: Vec<Answer> = all.iter().map(|answers| answers[p][lane]).collect();
            let mut agree = true;
            for (i, j, agreement) in &mut pairs {
                agree &= agreement.add(&said[*i], &said[*j]);
            }
            for (score, answer) in scores.iter_mut().zip(&said) {
                score.hits += u64::from(answer.is_hit());
            }
            if !agree {
                let shadow = replay.class.is_shadow();
                let wrong = judged(geometry, backends, packet, lane, &said, shadow);
                for (score, wrong) in scores.iter_mut().zip(wrong) {
                    score.wrong += u64::from(wrong);
                }
            }
        }
    }
    (scores, pairs)
}

/// Returns for each backend whether its answer in lane `lane` is provably wrong.
///
/// An occlusion names no primitive. So the closest hits of all backends are tested in its place.
fn judged(
    geometry: &Geometry,
    backends: &[&dyn Accelerator],
    packet: &PacketToTrace,
    lane: usize,
    said: &[Answer],
    shadow: bool,
) -> Vec<bool> {
    if !shadow {
        return refute::closest(geometry, &packet.rays, lane, said);
    }
    let hits: Vec<bool> = said.iter().map(Answer::is_hit).collect();
    let closest = |b: &&dyn Accelerator| answers(*b, packet, false, Coherence::Single)[lane];
    let witnesses: Vec<Answer> = backends.iter().map(closest).collect();
    refute::occluded(geometry, &packet.rays, lane, &hits, &witnesses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_answers_are_classified() {
        let hit = |prim, t: f32| Answer::Hit { geom: 0, prim, t: f64::from(t) };
        let occluded = Answer::Occluded;
        let of = |a, b| {
            let mut agreement = Agreement::default();
            let agree = agreement.add(&a, &b);
            assert_eq!(agree, agreement.disagreements() == 0);
            let Agreement { same, tie, depth, missed } = agreement;
            [same, tie, depth, missed]
        };
        assert_eq!(of(Answer::Miss, Answer::Miss), [1, 0, 0, 0]);
        assert_eq!(of(occluded, occluded), [1, 0, 0, 0]);
        assert_eq!(of(occluded, Answer::Miss), [0, 0, 0, 1]);
        assert_eq!(of(hit(1, 2.0), hit(1, 2.000001)), [1, 0, 0, 0]);
        assert_eq!(of(hit(1, 2.0), hit(2, 2.0)), [0, 1, 0, 0]);
        assert_eq!(of(hit(1, 2.0), hit(1, 2.001)), [0, 0, 1, 0]);
        assert_eq!(of(hit(1, 2.0), hit(2, f32::NAN)), [0, 0, 1, 0]);
        assert_eq!(of(Answer::Miss, hit(1, 2.0)), [0, 0, 0, 1]);
    }
}
