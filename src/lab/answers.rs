//! Compares the answers of all backends to the same rays.

use serde::{Deserialize, Serialize};

use super::judge;
use super::rays::Recorded;
use super::replay::{Answer, Replay, answers};
use crate::accel::Accelerator;
use crate::geometry::Geometry;
use crate::ray::{Coherence, LANES};

/// Largest relative difference of two distances that count as the same: 80 times the rounding of
/// f32. A larger difference is judged in f64.
const SAME_T: f32 = 1e-5;

/// Number of rays of a pair of backends, by how the two answers compare.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Agreement {
    /// The same primitive at the same t, two misses, or the same occlusion.
    pub same: u64,
    /// Different primitives at the same t.
    pub tie: u64,
    /// Hits at different t.
    pub depth: u64,
    /// One backend hits, the other misses.
    pub missed: u64,
}

impl Agreement {
    fn add(&mut self, a: &Answer, b: &Answer) -> bool {
        let near = (a.t - b.t).abs() <= SAME_T * a.t.abs().max(b.t.abs());
        let shadow = a.t == f32::INFINITY && b.t == f32::INFINITY;
        let count = match (a.hit == b.hit, !a.hit || shadow, near) {
            (false, ..) => &mut self.missed,
            (_, true, _) => &mut self.same,
            (.., false) => &mut self.depth,
            _ if (a.geom, a.prim) == (b.geom, b.prim) => &mut self.same,
            _ => &mut self.tie,
        };
        *count += 1;
        a.hit == b.hit && (!a.hit || shadow || near)
    }

    /// Number of rays whose answers differ by more than a tie.
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
                score.hits += u64::from(answer.hit);
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

fn judged(
    geometry: &Geometry,
    backends: &[&dyn Accelerator],
    packet: &Recorded,
    lane: usize,
    said: &[Answer],
    shadow: bool,
) -> Vec<bool> {
    if !shadow {
        return judge::closest(geometry, &packet.rays, lane, said);
    }
    let hits: Vec<bool> = said.iter().map(|answer| answer.hit).collect();
    let closest = |b: &&dyn Accelerator| answers(*b, packet, false, Coherence::Single)[lane];
    let witnesses: Vec<Answer> = backends.iter().map(closest).collect();
    judge::occluded(geometry, &packet.rays, lane, &hits, &witnesses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_answers_are_classified() {
        let hit = |prim, t| Answer { hit: true, geom: 0, prim, t };
        let occluded = Answer { hit: true, ..Answer::MISS };
        let of = |a, b| {
            let mut agreement = Agreement::default();
            let agree = agreement.add(&a, &b);
            assert_eq!(agree, agreement.disagreements() == 0);
            let Agreement { same, tie, depth, missed } = agreement;
            [same, tie, depth, missed]
        };
        assert_eq!(of(Answer::MISS, Answer::MISS), [1, 0, 0, 0]);
        assert_eq!(of(occluded, occluded), [1, 0, 0, 0]);
        assert_eq!(of(occluded, Answer::MISS), [0, 0, 0, 1]);
        assert_eq!(of(hit(1, 2.0), hit(1, 2.000001)), [1, 0, 0, 0]);
        assert_eq!(of(hit(1, 2.0), hit(2, 2.0)), [0, 1, 0, 0]);
        assert_eq!(of(hit(1, 2.0), hit(1, 2.001)), [0, 0, 1, 0]);
        assert_eq!(of(hit(1, 2.0), hit(2, f32::NAN)), [0, 0, 1, 0]);
        assert_eq!(of(Answer::MISS, hit(1, 2.0)), [0, 0, 0, 1]);
    }
}
