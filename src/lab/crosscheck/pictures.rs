//! Compares the pictures of two backends: counts the pixels that differ, and checks whether their
//! rays explain the difference.

use std::sync::Mutex;

use serde::Serialize;

use super::check::CrossCheck;
use crate::accel::brute::Brute;
use crate::accel::lane::{LaneRay, lanes};
use crate::accel::{Accelerator, BuildInfo};
use crate::error::Result;
use crate::film::{Film, Window};
use crate::geometry::{Geometry, Nearby};
use crate::integrate::{RenderContext, TileKernel};
use crate::lab::answer::Answer;
use crate::lab::backend::{BuiltBackend, must_be_right};
use crate::lab::query::QueryPacket;
use crate::lab::rays::PacketToTrace;
use crate::lab::verdict::{Verdict, judge};
use crate::monitor::Monitor;
use crate::parallel;
use crate::ray::{Coherence, Mask, RayPacket, Rays};
use crate::render::render;
use crate::simd::{self, Isa};
use crate::units::counted;

/// Largest relative difference of a channel for pixels that count as the same.
const SAME: f32 = 1e-5;

/// Smallest share of pixels that must be the same.
const SHARE: f64 = 0.999;

/// Largest number of differing pixels whose rays are checked.
const EXPLAINED: usize = 10_000;

/// Comparison of the pictures of two backends.
#[derive(Debug, Clone, Serialize)]
pub struct PictureReport {
    /// Names of the two backends.
    pub backends: [String; 2],
    /// Number of pixels of the frame.
    pub pixels: u64,
    /// Number of pixels that are the same, to a relative 1e-5.
    pub same: u64,
    /// Number of other pixels that the error bounds explain: a ray passes an outline, or hits two
    /// surfaces at the same depth.
    pub explained: u64,
    /// Number of other pixels with a ray that the first backend, or the second, answers wrong. A
    /// pixel with wrong rays of both counts for both.
    pub wrong: [u64; 2],
    /// Number of other pixels that no ray explains.
    pub unexplained: u64,
    /// Number of other pixels that were not checked: those after the first 10,000.
    pub not_looked_into: u64,
    /// Column and row, from the top left, of the first pixel that nothing explains.
    pub first_unexplained: Option<[u32; 2]>,
}

impl PictureReport {
    /// Reason why the pictures fail the check, or `None`.
    pub fn failure(&self) -> Option<String> {
        let [a, b] = &self.backends;
        let share = self.same as f64 / self.pixels as f64;
        let mut wrong = self.backends.iter().zip(self.wrong);
        if let Some((name, n)) = wrong.find(|&(name, n)| n > 0 && must_be_right(name)) {
            let differ = counted(n, ["pixel differs", "pixels differ"]);
            return Some(format!(
                "pictures of `{a}` and `{b}`: {differ} by rays that `{name}` answers wrong"
            ));
        }
        if let Some([x, y]) = self.first_unexplained {
            let differ = counted(self.unexplained, ["pixel differs", "pixels differ"]);
            return Some(format!(
                "pictures of `{a}` and `{b}`: {differ} outside of outlines, the first at x {x}, y {y}"
            ));
        }
        (share < SHARE).then(|| {
            format!(
                "pictures of `{a}` and `{b}`: {:.3}% of the pixels are the same, expected at least {:.1}%",
                100.0 * share,
                100.0 * SHARE
            )
        })
    }
}

/// Renders the frame with every backend and compares each picture with the first.
///
/// # Errors
/// `Interrupted` after a signal; the errors of [`Film::new`].
pub fn compare_pictures(
    check: &CrossCheck,
    isa: Isa,
    monitor: &Monitor,
) -> Result<Vec<PictureReport>> {
    let CrossCheck { world, oracle, built_backends, .. } = *check;
    let [width, height] = world.frame;
    let pixel = |i: usize| [i as u32 % width, i as u32 / width];
    let picture = |built: &BuiltBackend| -> Result<Film> {
        let mut film = Film::new(world.frame, Window::full(width, height))?;
        render(world, built.accelerator, isa, &mut film, monitor)?;
        Ok(film)
    };
    let Some((first, others)) = built_backends.split_first() else { return Ok(Vec::new()) };
    let context = RenderContext { world, accelerator: first.accelerator, isa, monitor };
    let reference = picture(first)?;
    let mut reports = Vec::new();
    for other in others {
        let film = picture(other)?;
        let different: Vec<usize> = (0..film.pixels.len())
            .filter(|&i| !same(&reference.pixels[i], &film.pixels[i]))
            .collect();
        let looked_into = &different[..different.len().min(EXPLAINED)];
        let reasons = parallel::try_map(looked_into.iter(), |&i| {
            let (built_backends, reason) = ([*first, *other], Mutex::default());
            monitor.check()?;
            Ok(explain(context, Witness { oracle, built_backends, reason }, pixel(i)))
        });
        let reasons = reasons?;
        // A signal leaves a pixel unfinished.
        monitor.check()?;
        let count = |is: fn(&Reason) -> bool| reasons.iter().filter(|r| is(r)).count() as u64;
        let unexplained = reasons.iter().position(|r| *r == Reason::default());
        reports.push(PictureReport {
            backends: [&first.tested.name, &other.tested.name].map(String::clone),
            pixels: film.pixels.len() as u64,
            same: (film.pixels.len() - different.len()) as u64,
            explained: count(|r| r.bound && r.wrong == [false; 2]),
            wrong: [count(|r| r.wrong[0]), count(|r| r.wrong[1])],
            unexplained: count(|r| *r == Reason::default()),
            not_looked_into: (different.len() - looked_into.len()) as u64,
            first_unexplained: unexplained.map(|i| pixel(looked_into[i])),
        });
    }
    Ok(reports)
}

/// Returns whether two pixels count as the same. NaN is the same as NaN, and infinity as itself.
fn same(a: &[f32; 4], b: &[f32; 4]) -> bool {
    let near = |a: f32, b: f32| (a - b).is_finite() && (a - b).abs() <= SAME * a.abs().max(b.abs());
    a.iter().zip(b).all(|(&a, &b)| a == b || a.is_nan() && b.is_nan() || near(a, b))
}

/// Reasons why a pixel differs. The default value means that nothing explains it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Reason {
    /// A ray has two different answers, and they do not both agree with the oracle.
    bound: bool,
    /// The first backend, or the second, answers a ray wrong.
    wrong: [bool; 2],
}

/// Renders one pixel again and judges the rays for which the two backends of `witness` differ.
fn explain(context: RenderContext, witness: Witness, [x, y]: [u32; 2]) -> Reason {
    let mut pixel = [[0.0; 4]];
    let mut rows = [&mut pixel[..]];
    let context = RenderContext { accelerator: &witness, ..context };
    let window = Window { x0: x, y0: y, x1: x + 1, y1: y + 1 };
    simd::dispatch(context.isa, TileKernel::beauty(context, window, &mut rows));
    witness.reason.into_inner().unwrap_or_default()
}

/// An accelerator that answers like its first backend, and judges the rays for which the second
/// differs.
///
/// Packets are the same as in the render, so some of their rays belong to neighbours of the pixel.
struct Witness<'a> {
    oracle: &'a Brute<'a>,
    built_backends: [BuiltBackend<'a>; 2],
    reason: Mutex<Reason>,
}

impl Witness<'_> {
    /// Traces the packet on both backends and judges the rays for which they differ. The caller
    /// then traces the packet on the first backend again, which is simpler.
    fn compare(&self, active: &Mask, rays: &Rays, shadow: bool, coherence: Coherence) {
        let packet = PacketToTrace { active: *active, rays: rays.clone() };
        let case = QueryPacket { source: String::new(), shadow, coherence, packet };
        let both = self.built_backends.map(|c| case.answers(c.accelerator, coherence));
        for i in lanes(active).filter(|&i| both[0][i] != both[1][i]) {
            let ray = LaneRay::of(rays, i);
            let truth = Answer::truth(self.oracle, &ray, shadow);
            let verdict = |k: usize| {
                judge(
                    self.oracle,
                    &ray,
                    truth,
                    both[k][i],
                    self.built_backends[k].tested.error_factor(),
                )
            };
            let verdicts = [verdict(0), verdict(1)];
            if let Ok(mut reason) = self.reason.lock() {
                // Two agreeing answers differ only in the rounding of t, which shading does not
                // use.
                reason.bound |= verdicts != [Verdict::Agree; 2];
                for (wrong, verdict) in reason.wrong.iter_mut().zip(verdicts) {
                    *wrong |= verdict.is_wrong();
                }
            }
        }
    }
}

impl Accelerator for Witness<'_> {
    fn info(&self) -> BuildInfo {
        self.built_backends[0].accelerator.info()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.compare(active, &packet.rays, false, coherence);
        self.built_backends[0].accelerator.closest(active, packet, coherence);
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.built_backends[0].accelerator.near(geometry, nearby, found);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.compare(active, rays, true, coherence);
        self.built_backends[0].accelerator.occluded(active, rays, coherence);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_is_the_same_as_nan_alone() {
        let nan = [f32::NAN, 1.0, f32::INFINITY, 1.0];
        assert!(same(&nan, &nan));
        assert!(!same(&nan, &[0.0, 1.0, f32::INFINITY, 1.0]));
        for other in [f32::NEG_INFINITY, 1.0] {
            assert!(!same(&nan, &[f32::NAN, 1.0, other, 1.0]), "{other}");
        }
        assert!(same(&[1.0; 4], &[1.0 + 5e-6; 4]) && !same(&[1.0; 4], &[1.0 + 5e-5; 4]));
    }
}
