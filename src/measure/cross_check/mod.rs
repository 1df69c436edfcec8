//! Every ray through every backend, each answer judged by the oracle.
//!
//! The rays are the scene's own and seeded ones that are hard to answer. An answer agrees, or is
//! explained by the error bound of the backend's own test (a tie, an edge), or is wrong. The bound
//! is that of `bvh`'s test ([`Brute::near`]); Embree, whose bound is not published, gets four times
//! as much, `coursework`, which works in f64, the same, `brute` none.

mod aimed;
mod cover;
mod known;
mod pictures;
mod plan;
mod report;
mod source;
mod verdict;

pub use self::cover::{Layer, layers};
pub use self::pictures::{PictureReport, compare_pictures};
pub use self::report::{
    BackendReport, Finding, PlainLoop, Report, SavedRay, Tally, Tree, must_be_right,
};
pub use self::source::Source;
pub use self::verdict::{Answer, MOST_NEAR, Verdict, judge};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::plan::Plan;
use super::rays::Recorded;
use crate::accel::brute::Brute;
use crate::accel::coursework::Coursework;
use crate::accel::lane::{Hit, Ray, lanes};
use crate::accel::{Accelerator, Visits};
use crate::error::Result;
use crate::monitor::{Monitor, Phase};
use crate::ray::{Coherence, Hits, LANES, RayPacket};
use crate::scene::Backend;
use crate::world::World;

/// Primitives that `coursework`'s plain loop may test in all: what bounds its time.
const PLAIN_LOOP_TESTS: u64 = 200_000_000;

/// Wrong answers that are kept of each backend, kind and class of rays.
const KEPT: usize = 10;

/// Packets between two looks at the monitor.
const PORTION: usize = 4096;

/// How rays are handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// 16 at a time, said to be coherent.
    Coherent,
    /// 16 at a time.
    Incoherent,
    /// Single rays, one query for each lane.
    Single,
}

impl Mode {
    fn coherence(self) -> Coherence {
        match self {
            Self::Coherent => Coherence::Coherent,
            Self::Incoherent => Coherence::Incoherent,
            Self::Single => Coherence::Single,
        }
    }
}

/// A backend that is checked.
#[derive(Clone, Copy)]
pub struct Contender<'a> {
    /// Backend that is checked.
    pub backend: Backend,
    /// Built over the world's geometry.
    pub accelerator: &'a dyn Accelerator,
}

/// The bound of a backend's own test, in units of the shear's.
pub fn factor(backend: Backend) -> f64 {
    match backend {
        Backend::Embree(_) => 4.0,
        Backend::Bvh(_) | Backend::Coursework => 1.0,
        Backend::Brute => 0.0,
    }
}

impl Contender<'_> {
    /// The bound of its own test, in units of the shear's.
    pub fn factor(&self) -> f64 {
        factor(self.backend)
    }

    /// The ways in which its answers may differ.
    fn modes(&self, coherence: Coherence) -> Vec<Mode> {
        let packets = match coherence {
            Coherence::Coherent => Mode::Coherent,
            Coherence::Incoherent | Coherence::Single => Mode::Incoherent,
        };
        match self.backend {
            Backend::Embree(_) | Backend::Bvh(_) => vec![packets, Mode::Single],
            // One ray at a time in any case.
            Backend::Coursework | Backend::Brute => vec![packets],
        }
    }
}

/// What is checked, and how much.
#[derive(Clone, Copy)]
pub struct Check<'a> {
    /// The scene whose rays are checked.
    pub world: &'a World,
    /// The oracle, built over the scene's geometry.
    pub oracle: &'a Brute<'a>,
    /// The backends to check. The first one finds the camera hits.
    pub contenders: &'a [Contender<'a>],
    /// To compare with its own plain loop.
    pub coursework: Option<&'a Coursework<'a>>,
    /// Rays at most; at least one packet of each kind that there is.
    pub rays: u64,
    /// Of all random rays.
    pub seed: i64,
}

/// A packet and what is asked of it.
#[derive(Debug, Clone)]
pub struct Case {
    /// Name of its source.
    pub source: String,
    /// `occluded` instead of `closest`.
    pub shadow: bool,
    /// The renderer's, for packets.
    pub coherence: Coherence,
    /// The rays before the query.
    pub packet: Recorded,
}

/// Traces a packet and returns the answers of all lanes; those that are not active say nothing.
pub fn answers(accelerator: &dyn Accelerator, case: &Case, mode: Mode) -> Vec<Answer> {
    let Recorded { active, rays } = &case.packet;
    if case.shadow {
        let mut rays = rays.clone();
        accelerator.occluded(active, &mut rays, mode.coherence());
        (0..LANES).map(|i| Answer::occluded(&rays, i)).collect()
    } else {
        let mut packet = RayPacket { rays: rays.clone(), hits: Hits::EMPTY };
        accelerator.closest(active, &mut packet, mode.coherence());
        (0..LANES).map(|i| Answer::closest(&packet, i)).collect()
    }
}

/// Checks the rays of a scene, on the threads of the current rayon pool. The same report for any
/// number of threads.
///
/// # Errors
/// `Interrupted` after a signal.
pub fn check_rays(check: &Check, monitor: &Monitor) -> Result<Report> {
    let plan = Plan::new(check, monitor)?;
    let primitives = u64::from(*check.world.geometry.bases().last().unwrap_or(&0));
    let loops = (PLAIN_LOOP_TESTS / primitives.max(1)).max(1);
    // Every n-th packet goes through the plain loop as well.
    let stride = (plan.packets() as u64 * LANES as u64).div_ceil(loops).max(1) as usize;
    let mut report = Report::new(check);
    monitor.begin(Phase::Check, plan.packets() as u64);
    // In portions, so that memory stays bounded and a signal is seen.
    for first in (0..plan.packets()).step_by(PORTION) {
        let portion: Vec<Part> = (first..plan.packets().min(first + PORTION))
            .into_par_iter()
            .filter(|_| !monitor.stopped())
            .map(|index| check_packet(check, &plan.case(index), index % stride == 0))
            .collect();
        monitor.check()?;
        portion.iter().for_each(|part| report.add(part, KEPT));
        monitor.set_done((first + portion.len()) as u64);
    }
    report.allow_known(check.contenders);
    Ok(report)
}

/// All verdicts of one packet.
pub struct Part {
    case: Case,
    /// By contender, mode and lane.
    verdicts: Vec<(usize, Mode, usize, Verdict, Answer)>,
    /// The oracle's answers, by lane.
    truths: Vec<Answer>,
    /// Rays that went through the plain loop.
    looped: u64,
    /// Lanes where the plain loop finds something else, and what.
    unlike_loop: Vec<(usize, Answer, Answer)>,
}

/// Judges the answers of all contenders to one packet.
pub fn check_packet(check: &Check, case: &Case, with_loop: bool) -> Part {
    let Recorded { active, rays } = &case.packet;
    let mut truths = vec![Answer::Miss; LANES];
    for i in lanes(active) {
        truths[i] = Answer::truth(check.oracle, &Ray::of(rays, i), case.shadow);
    }
    let mut verdicts = Vec::new();
    for (index, contender) in check.contenders.iter().enumerate() {
        for mode in contender.modes(case.coherence) {
            let answers = answers(contender.accelerator, case, mode);
            for i in lanes(active) {
                let (ray, factor) = (Ray::of(rays, i), contender.factor());
                let verdict = judge(check.oracle, &ray, truths[i], answers[i], factor);
                verdicts.push((index, mode, i, verdict, answers[i]));
            }
        }
    }
    let mut part =
        Part { case: case.clone(), verdicts, truths, looped: 0, unlike_loop: Vec::new() };
    if let Some(coursework) = check.coursework.filter(|_| with_loop) {
        for i in lanes(active) {
            let ray = Ray::of(rays, i);
            let tree = coursework.closest_hit(&ray, &mut Visits::default());
            let all = coursework.plain_loop(&ray);
            part.looped += 1;
            if tree != all {
                let answer = |hit: Option<Hit>| hit.map_or(Answer::Miss, Answer::from);
                part.unlike_loop.push((i, answer(tree), answer(all)));
            }
        }
    }
    part
}

#[cfg(test)]
mod tests;
