//! What a check is given, and what it finds on one packet.

use crate::accel::brute::Brute;
use crate::accel::coursework::Coursework;
use crate::lab::answer::Answer;
use crate::lab::backend::BuiltBackend;
use crate::lab::query::QueryPacket;
use crate::lab::verdict::Verdict;
use crate::ray::Coherence;
use crate::world::World;

/// Scene, oracle, backends and number of rays of a check.
#[derive(Clone, Copy)]
pub struct CrossCheck<'a> {
    /// The scene whose rays are checked.
    pub world: &'a World,
    /// The oracle, built over the scene's geometry.
    pub oracle: &'a Brute<'a>,
    /// The backends to check. The first one finds the camera hits.
    pub built_backends: &'a [BuiltBackend<'a>],
    /// `coursework`, if its trees are to be compared with its own plain loop.
    pub coursework: Option<&'a Coursework<'a>>,
    /// Largest number of rays. At least one packet of each source is checked.
    pub rays: u64,
    /// Seed of all random rays.
    pub seed: i64,
}

/// All verdicts on one packet.
pub struct PacketVerdicts {
    pub(super) case: QueryPacket,
    /// Index of the backend, coherence, lane, verdict and answer.
    pub(super) verdicts: Vec<(usize, Coherence, usize, Verdict, Answer)>,
    /// The oracle's answer for each lane.
    pub(super) truths: Vec<Answer>,
    /// Number of rays that the plain loop of `coursework` traced.
    pub(super) looped: u64,
    /// Lanes where the answers of trees and plain loop differ, with both answers.
    pub(super) loop_mismatches: Vec<(usize, Answer, Answer)>,
}
