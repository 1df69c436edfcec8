//! Traces rays on every backend and judges each answer by the oracle, for `lightpath crosscheck`.
//!
//! The rays are those of the scene and seeded random rays that are hard to answer. An answer
//! agrees, or the error bound of the backend's own test explains it (a tie, an edge), or it is
//! wrong.
//!
//! Error bounds are multiples of the bound of `bvh`'s test
//! ([`Brute::near`](crate::accel::brute::Brute::near)): 1 for `bvh` and `coursework`, 4 for Embree,
//! 0 for `brute`. Embree's own bound is not published, so 4 is an assumption. `coursework` works
//! in f64.

mod aimed;
mod check;
mod known;
mod pictures;
mod plan;
mod report;
mod source;

pub use self::check::{CrossCheck, PacketVerdicts};
pub use self::pictures::{PictureReport, compare_pictures};
pub use self::report::{
    BackendReport, CrosscheckReport, Finding, PlainLoop, SavedRay, TreeReport, VerdictCounts,
};
pub use self::source::RaySource;

use self::plan::CheckPackets;
use super::answer::Answer;
use super::parallel::in_portions;
use super::query::QueryPacket;
use super::rays::PacketToTrace;
use super::verdict::judge;
use crate::accel::Visits;
use crate::accel::lane::{LaneRay, lanes};
use crate::error::Result;
use crate::monitor::{Monitor, Phase};
use crate::ray::LANES;

/// Largest number of primitive tests of the plain loop of `coursework` in all, unless one packet
/// needs more. It bounds the time.
const PLAIN_LOOP_TESTS: u64 = 200_000_000;

/// Largest number of wrong answers that are kept for each backend, verdict and source of rays.
const KEPT: usize = 10;

/// Checks the rays of a scene on the current rayon pool.
///
/// The report does not depend on the number of threads.
///
/// # Errors
/// `Interrupted` after a signal.
pub fn check_rays(check: &CrossCheck, monitor: &Monitor) -> Result<CrosscheckReport> {
    let plan = CheckPackets::new(check, monitor)?;
    let primitives = check.world.geometry.count();
    let loops = (PLAIN_LOOP_TESTS / primitives.max(1)).max(1);
    // The plain loop traces one of `stride` packets.
    let stride = (plan.packets() as u64 * LANES as u64).div_ceil(loops).max(1);
    let mut report = CrosscheckReport::new(check);
    monitor.begin(Phase::Check, plan.packets() as u64);
    let mut done = 0;
    in_portions(
        plan.packets() as u64,
        monitor,
        &|index| check_packet(check, &plan.case(index as usize), index % stride == 0),
        &mut |portion: Vec<PacketVerdicts>| {
            portion.iter().for_each(|part| report.add(part, KEPT));
            done += portion.len() as u64;
            monitor.set_done(done);
        },
    )?;
    report.allow_known(check.built_backends);
    Ok(report)
}

/// Judges the answers of all backends to one packet. Compares `coursework` with its plain loop if
/// `with_loop`.
pub fn check_packet(check: &CrossCheck, case: &QueryPacket, with_loop: bool) -> PacketVerdicts {
    let PacketToTrace { active, rays } = &case.packet;
    let mut truths = vec![Answer::Miss; LANES];
    for i in lanes(active) {
        truths[i] = Answer::truth(check.oracle, &LaneRay::of(rays, i), case.shadow);
    }
    let mut verdicts = Vec::new();
    for (index, backend) in check.built_backends.iter().enumerate() {
        for mode in backend.tested.coherences(case.coherence) {
            let answers = case.answers(backend.accelerator, mode);
            for i in lanes(active) {
                let (ray, factor) = (LaneRay::of(rays, i), backend.tested.error_factor());
                let verdict = judge(check.oracle, &ray, truths[i], answers[i], factor);
                verdicts.push((index, mode, i, verdict, answers[i]));
            }
        }
    }
    let mut part = PacketVerdicts {
        case: case.clone(),
        verdicts,
        truths,
        looped: 0,
        loop_mismatches: Vec::new(),
    };
    if let Some(coursework) = check.coursework.filter(|_| with_loop) {
        for i in lanes(active) {
            let ray = LaneRay::of(rays, i);
            let tree = coursework.closest_hit(&ray, &mut Visits::default());
            let all = coursework.plain_loop(&ray);
            part.looped += 1;
            if tree != all {
                let [tree, all] = [tree, all].map(|hit| Answer::of_hit(hit, false));
                part.loop_mismatches.push((i, tree, all));
            }
        }
    }
    part
}

#[cfg(test)]
mod tests;
