//! Measures one scene with several backends, for `lightpath bench`.

use std::time::Instant;

use super::ab::{TimingPlan, interleave};
use super::agreement::{self, Agreement};
use super::backend::{TestedBackend, build_all};
use super::rays::{RayClass, Recording, record};
use super::replay::{Mode, Replay};
use super::result::{BackendResult, PairResult, SceneResult, TimingRow, WorkKind};
use crate::accel::{self, Accelerator};
use crate::error::Result;
use crate::film::{Film, Window};
use crate::monitor::Monitor;
use crate::ray::LANES;
use crate::render::render;
use crate::simd::Isa;
use crate::threads::{self, Pool};
use crate::units::plural;
use crate::world::World;

/// Backends, rays and repetitions of a measurement.
#[derive(Debug, Clone)]
pub struct BenchSettings {
    /// Backends to compare, at least one. The first is the reference of all ratios. It also finds
    /// the hits from which secondary rays start.
    pub tested_backends: Vec<TestedBackend>,
    /// Classes of rays to replay.
    pub classes: Vec<RayClass>,
    /// Numbers of worker threads, each >= 1.
    pub threads: Vec<usize>,
    /// Largest number of rays of each class, rounded up to whole packets of 16.
    pub rays: u64,
    /// Seed of the diffuse rays.
    pub seed: i64,
    /// Instruction set of the shading in whole pictures, for all backends.
    pub isa: Isa,
    /// Rounds and time for replays of rays.
    pub plan: TimingPlan,
    /// Rounds and time for builds and whole pictures.
    pub slow_plan: TimingPlan,
}

/// Runs all measurements of a scene, which is yet without a name and a hash. Calls `note` with the
/// name of each step when it begins.
///
/// # Errors
/// - `Retry` if the system cannot start the threads.
/// - The errors of [`accel::build`] and [`Film::new`].
/// - `Interrupted` after a signal.
pub fn measure(
    world: &World,
    settings: &BenchSettings,
    monitor: &Monitor,
    note: &(dyn Fn(&str) + Sync),
) -> Result<SceneResult> {
    let most = settings.threads.iter().copied().max().unwrap_or(1);
    let pools = settings.threads.iter().map(|&n| threads::pool(n)).collect::<Result<Vec<_>>>()?;
    let bench = Bench { world, settings, monitor, note };
    threads::pool(most)?.install(|| bench.all(&pools))
}

/// Scores and visits of one replay. They do not depend on the number of threads.
struct ReplayScores {
    class: RayClass,
    mode: Mode,
    scores: Vec<agreement::Score>,
    visits: Vec<Option<accel::Visits>>,
}

struct Bench<'a> {
    world: &'a World,
    settings: &'a BenchSettings,
    monitor: &'a Monitor,
    note: &'a (dyn Fn(&str) + Sync),
}

impl<'a> Bench<'a> {
    /// Runs all measurements. The current pool builds the accelerators for rays and pictures, and
    /// computes all answers. `pools` run what is timed.
    fn all(&self, pools: &[Pool]) -> Result<SceneResult> {
        let mut rows = Vec::new();
        for pool in pools {
            rows.push(pool.install(|| self.builds())?);
        }
        let tested = &self.settings.tested_backends;
        let built =
            build_all(tested, &self.world.geometry, rayon::current_num_threads(), self.monitor)?;
        (self.note)("recording rays");
        let packets = (self.settings.rays.div_ceil(LANES as u64) as usize).max(1);
        let seed = self.settings.seed;
        let recording = record(self.world, &*built[0], packets, seed, self.monitor)?;
        let backends: Vec<&dyn Accelerator> = built.iter().map(|b| &**b).collect();
        let (judged, agreement) = self.compare(&backends, &recording);
        for pool in pools {
            rows.extend(pool.install(|| self.rays(&backends, &recording, &judged))?);
            rows.push(pool.install(|| self.image(&backends))?);
        }
        let backends = self.settings.tested_backends.iter().zip(&built).enumerate();
        let backends = backends.map(|(i, (tested_backend, accelerator))| {
            let info = accelerator.info();
            BackendResult {
                name: tested_backend.name.clone(),
                version: info.version,
                isa: info.isa,
                bytes: info.bytes,
                peak_bytes: info.peak_bytes,
                wrong: judged.iter().map(|j| j.scores[i].wrong).sum(),
            }
        });
        let rays = |&class: &RayClass| (class.name().to_string(), recording.count(class));
        Ok(SceneResult {
            triangles: self.world.triangles(),
            rays: self.settings.classes.iter().map(rays).collect(),
            backends: backends.collect(),
            rows,
            agreement,
            ..SceneResult::default()
        })
    }

    fn builds(&self) -> Result<TimingRow> {
        let threads = rayon::current_num_threads();
        (self.note)(&format!("build, {}", plural(threads, "thread")));
        let tested = &self.settings.tested_backends;
        let samples = interleave(tested.len(), self.settings.slow_plan, self.monitor, |i| {
            let started = Instant::now();
            let built = tested[i].build(&self.world.geometry, threads, self.monitor)?;
            let seconds = started.elapsed().as_secs_f64();
            drop(built);
            Ok(seconds)
        })?;
        let work = vec![self.world.primitives().primitives; tested.len()];
        Ok(TimingRow::new(WorkKind::Build, "build", "", threads, &work, samples))
    }

    /// The replays of all chosen classes for which the scene has rays, in both modes.
    fn replays<'r>(&self, recording: &'r Recording) -> Vec<Replay<'r>> {
        let classes = self.settings.classes.iter().flat_map(|&class| {
            let packets = recording.packets(class);
            Mode::ALL.map(|mode| Replay { class, mode, packets })
        });
        classes.filter(|replay| !replay.packets.is_empty()).collect()
    }

    fn compare(
        &self,
        built: &[&dyn Accelerator],
        recording: &Recording,
    ) -> (Vec<ReplayScores>, Vec<PairResult>) {
        (self.note)("comparing answers");
        let (mut judged, mut agreements) = (Vec::new(), Vec::new());
        for replay in self.replays(recording) {
            let Replay { class, mode, .. } = replay;
            let (scores, pairs) = agreement::compare(&replay, &self.world.geometry, built);
            let visits = built.iter().map(|b| replay.visits(*b)).collect();
            judged.push(ReplayScores { class, mode, scores, visits });
            let name = |i: usize| self.settings.tested_backends[i].name.clone();
            let pair = |(i, j, agreement): (usize, usize, Agreement)| PairResult {
                name: class.name().into(),
                mode: mode.name().into(),
                backends: [name(i), name(j)],
                agreement,
            };
            agreements.extend(pairs.into_iter().map(pair));
        }
        (judged, agreements)
    }

    fn rays(
        &self,
        built: &[&dyn Accelerator],
        recording: &Recording,
        judged: &[ReplayScores],
    ) -> Result<Vec<TimingRow>> {
        let threads = rayon::current_num_threads();
        let mut rows = Vec::new();
        for replay in self.replays(recording) {
            let (class, mode) = (replay.class, replay.mode);
            (self.note)(&format!(
                "{}, {}, {}",
                class.name(),
                mode.name(),
                plural(threads, "thread")
            ));
            let samples = interleave(built.len(), self.settings.plan, self.monitor, |i| {
                Ok(replay.seconds(built[i]))
            })?;
            let rays = recording.count(class);
            let work = vec![rays; built.len()];
            let mut row =
                TimingRow::new(WorkKind::Rays, class.name(), mode.name(), threads, &work, samples);
            let judged = judged.iter().find(|j| (j.class, j.mode) == (class, mode));
            for (i, entry) in row.entries.iter_mut().enumerate() {
                let Some(judged) = judged else { continue };
                entry.hits = Some(judged.scores[i].hits);
                entry.wrong = Some(judged.scores[i].wrong);
                let per_ray = |n: u64| n as f64 / rays as f64;
                entry.nodes_per_ray = judged.visits[i].map(|v| per_ray(v.nodes));
                entry.primitives_per_ray = judged.visits[i].map(|v| per_ray(v.primitives));
            }
            rows.push(row);
        }
        Ok(rows)
    }

    fn image(&self, built: &[&dyn Accelerator]) -> Result<TimingRow> {
        let threads = rayon::current_num_threads();
        (self.note)(&format!("image, {}", plural(threads, "thread")));
        let [width, height] = self.world.frame;
        let mut film = Film::new([width, height], Window::full(width, height))?;
        let mut work = vec![0; built.len()];
        let samples = interleave(built.len(), self.settings.slow_plan, self.monitor, |i| {
            let started = Instant::now();
            let counts = render(self.world, built[i], self.settings.isa, &mut film, self.monitor)?;
            let seconds = started.elapsed().as_secs_f64();
            work[i] = counts.all();
            Ok(seconds)
        })?;
        Ok(TimingRow::new(WorkKind::Image, "image", "", threads, &work, samples))
    }
}
