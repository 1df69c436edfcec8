//! Cases of the catalogue, their pass criteria, and the run of one case.

use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use super::backends::CaseBackends;
use super::counts::{CaseCounts, WrongKind};
use super::judge::{AimedPacket, judge_packet};
use super::picture;
use super::report::{BackendCounts, CaseResult, FailurePicture};
use super::settings::AccuracySettings;
use crate::accel::BuildOptions;
use crate::accel::brute::Brute;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::lab::backend::build_all;
use crate::lab::parallel::in_portions;
use crate::lab::random::Random;
use crate::monitor::Monitor;
use crate::ray::LANES;
use crate::scene::{Backend, EmbreeMode};

/// Largest share of hits whose t may be off by more than 2 ulp.
const COARSE: f64 = 1e-4;

/// Largest allowed error of a barycentric weight.
const WEIGHT: f64 = 1e-6;

/// Pass criterion of a case, for the backends that must be right:
/// [`crate::lab::backend::TestedBackend::must_be_right`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PassCriterion {
    /// No wrong answer. t within 2 ulp for 99.99% of the hits and within 8 ulp for all, refined
    /// points within 2^-23 of their scale for 99.99%, weights within 1e-6.
    Exact,
    /// No wrong answer. The text says why t has no bound. Points and weights have none either.
    Zero(&'static str),
    /// No wrong answer, weights within 1e-6. The values are the largest share of hits with t off by
    /// more than 2 ulp, and with points off by more than 2^-23 of their scale, and the reason.
    Coarse(f64, &'static str),
}

impl PassCriterion {
    /// The criterion as the table of results shows it.
    pub fn text(&self) -> String {
        match self {
            Self::Exact => "0; t within 2 ulp, 8 at worst".into(),
            Self::Zero(why) => format!("0 ({why})"),
            Self::Coarse(share, why) => {
                format!("0; t within 2 ulp for {}% ({why})", 100.0 - share * 100.0)
            }
        }
    }

    /// Returns why the counts do not meet the criterion, or `None` if they do.
    pub fn missed(&self, counts: &CaseCounts) -> Option<String> {
        let (failed, rays) = (counts.failed(), counts.rays);
        if failed > 0 {
            return Some(format!("{failed} of {rays} answers fail, expected at most 0"));
        }
        if rays == 0 {
            return Some("no ray was traced".into());
        }
        let share = match self {
            Self::Exact => COARSE,
            Self::Coarse(share, _) => *share,
            Self::Zero(_) => return None,
        };
        let (coarse, hits) = (counts.beyond_2, counts.measured);
        if *self == Self::Exact && counts.beyond_8 > 0 {
            return Some(format!("t is off by {:.1} ulp, expected at most 8", counts.worst_ulp));
        }
        if coarse as f64 > share * hits as f64 {
            return Some(format!("{coarse} of {hits} hits have t more than 2 ulp off"));
        }
        let off = counts.points_off;
        if off as f64 > share * hits as f64 {
            return Some(format!(
                "{off} of {hits} hits have a point more than 2^-23 off, relative"
            ));
        }
        let weight = counts.worst_weight;
        (weight > WEIGHT).then(|| format!("a weight is off by {weight:.1e}, expected 1e-6"))
    }
}

/// Function that runs a case and adds its counts to the [`CaseRun`].
type Work = Box<dyn Fn(&mut CaseRun) -> Result<()> + Send + Sync>;

/// A case of the catalogue: geometry and rays with known answers.
pub struct Case {
    /// Name of the part of the catalogue.
    pub group: &'static str,
    /// Name of the case, unique in the catalogue. It seeds the random rays.
    pub name: String,
    /// Description of the rays and of the right answers.
    pub what: String,
    /// Criterion that a backend must meet to pass.
    pub criterion: PassCriterion,
    work: Work,
}

impl Case {
    /// Creates a case whose function is `work`.
    pub fn new(
        group: &'static str,
        name: impl Into<String>,
        what: impl Into<String>,
        criterion: PassCriterion,
        work: impl Fn(&mut CaseRun) -> Result<()> + Send + Sync + 'static,
    ) -> Self {
        Self { group, name: name.into(), what: what.into(), criterion, work: Box::new(work) }
    }

    /// Runs the case on every tested backend and returns its row of results.
    pub(super) fn run(&self, settings: &AccuracySettings, monitor: &Monitor) -> Result<CaseResult> {
        let started = Instant::now();
        // The seed depends on the name of the case, not on its place in the catalogue.
        let salt = self.name.bytes().fold(settings.seed, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let columns = &settings.tested_backends;
        let counts = vec![CaseCounts::default(); columns.len()];
        let mut run = CaseRun { settings, monitor, salt, counts, pictures: vec![], note: None };
        (self.work)(&mut run)?;
        let CaseRun { counts, pictures, note, .. } = run;
        let entries = columns.iter().zip(&counts).map(|(column, counts)| {
            let missed = self.criterion.missed(counts).filter(|_| column.must_be_right());
            BackendCounts::new(counts, missed.or_else(|| counts.has_any(forbidden(column.backend))))
        });
        Ok(CaseResult {
            group: self.group.into(),
            name: self.name.clone(),
            what: self.what.clone(),
            mark: self.criterion.text(),
            note,
            rays: counts.iter().map(|counts| counts.rays).max().unwrap_or(0),
            entries: entries.collect(),
            seconds: started.elapsed().as_secs_f64(),
            pictures,
        })
    }
}

/// Kinds of errors that fail the run even if the backend need not be right.
///
/// They apply to robust Embree, because `--backend embree` renders with it, and to its compact
/// mode. Leaks of both are only published.
pub fn forbidden(backend: Backend) -> &'static [WrongKind] {
    match backend {
        Backend::Embree(EmbreeMode::Robust | EmbreeMode::Compact) => {
            &[WrongKind::FalseHit, WrongKind::SelfShadow]
        }
        _ => &[],
    }
}

/// State of a case while it runs: settings in, counts out.
pub struct CaseRun<'a> {
    /// Backends, seed and number of rays.
    pub settings: &'a AccuracySettings,
    /// Receives progress and carries signals.
    pub monitor: &'a Monitor,
    /// Seed of the random numbers of this case.
    salt: u64,
    /// Counts of each tested backend so far.
    pub counts: Vec<CaseCounts>,
    /// Pictures of failures, at most one for each tested backend.
    pictures: Vec<FailurePicture>,
    /// Remark for the table of results.
    pub note: Option<String>,
}

/// Number of packets of a case, for fast and slow backends.
#[derive(Debug, Clone, Copy)]
pub struct Amount {
    /// Number of packets in the quick run.
    pub packets: u64,
    /// Slow backends trace one of this many packets.
    pub slow_stride: u64,
    /// The oracle answers one of this many packets of `Expect::Closed`, and all packets of other
    /// expectations.
    pub oracle_stride: u64,
}

impl CaseRun<'_> {
    /// Returns sequence `index` of the random numbers of this case.
    pub fn random(&self, index: u64) -> Random {
        Random::new(self.salt, index)
    }

    /// Builds every tested backend and the oracle over a geometry. A small geometry is built faster
    /// with one thread.
    ///
    /// # Errors
    /// The errors of the builds.
    pub(super) fn build<'g>(&'g self, geometry: &'g Geometry) -> Result<CaseBackends<'g>> {
        let threads = if geometry.count() < 1000 { 1 } else { rayon::current_num_threads() };
        let tested = &self.settings.tested_backends;
        let accelerators = build_all(tested, geometry, threads, self.monitor)?;
        Ok(CaseBackends { geometry, tested, accelerators, oracle: oracle(geometry, self.monitor)? })
    }

    /// Traces packets, created by `aim`, with every tested backend and judges the answers.
    ///
    /// # Errors
    /// The errors of the builds; `Interrupted` after a signal.
    pub fn trace(
        &mut self,
        geometry: &Geometry,
        amount: Amount,
        aim: impl Fn(&mut Random) -> AimedPacket + Sync,
    ) -> Result<()> {
        let times = self.settings.times;
        // In a long run the slow backends trace at most 16 times the rays of the quick run.
        let slow = amount.slow_stride * times.div_ceil(16);
        self.check_packets(geometry, amount.packets * times, |run, built, index| {
            let aimed = aim(&mut run.random(index));
            let known = index % amount.oracle_stride == 0;
            judge_packet(built, &aimed, index, known, index % slow == 0)
        })
    }

    /// Builds every tested backend over a geometry and judges packets on the threads of the current
    /// rayon pool. Keeps the counts: see [`CaseRun::keep`].
    ///
    /// `judge` returns the counts of each tested backend for the packet of an index.
    ///
    /// # Errors
    /// The errors of the builds; `Interrupted` after a signal.
    pub(super) fn check_packets(
        &mut self,
        geometry: &Geometry,
        packets: u64,
        judge: impl Fn(&CaseRun, &CaseBackends, u64) -> Vec<CaseCounts> + Sync,
    ) -> Result<()> {
        let mut sums = vec![CaseCounts::default(); self.counts.len()];
        {
            let run = &*self;
            let built = run.build(geometry)?;
            in_portions(
                packets,
                run.monitor,
                &|index| judge(run, &built, index),
                &mut |portion: Vec<Vec<CaseCounts>>| {
                    for counts in &portion {
                        sums.iter_mut().zip(counts).for_each(|(sum, counts)| sum.add(counts));
                    }
                    run.monitor.rays.fetch_add((portion.len() * LANES) as u64, Relaxed);
                },
            )?;
        }
        self.keep(geometry, sums)
    }

    /// Adds the counts over a geometry. Draws a picture of the first failures of each tested
    /// backend that has no picture yet.
    ///
    /// # Errors
    /// The errors of the build that the pictures need.
    pub fn keep(&mut self, geometry: &Geometry, sums: Vec<CaseCounts>) -> Result<()> {
        if self.settings.pictures && sums.iter().any(|sum| !sum.places.is_empty()) {
            let view = picture::ParallelView::new(geometry, self.monitor)?;
            for (index, sum) in sums.iter().enumerate() {
                let seen = self.pictures.iter().any(|picture| picture.column == index);
                if sum.places.is_empty() || seen {
                    continue;
                }
                let name = self.settings.tested_backends[index].name.clone();
                self.pictures.push(FailurePicture {
                    column: index,
                    name,
                    png: view.png(&sum.places),
                });
            }
        }
        for (counts, sum) in self.counts.iter_mut().zip(&sums) {
            counts.add(sum);
        }
        Ok(())
    }
}

/// Builds the oracle over a geometry.
pub fn oracle<'g>(geometry: &'g Geometry, monitor: &Monitor) -> Result<Brute<'g>> {
    Brute::build(geometry, &BuildOptions { threads: 1, max_bytes: None }, monitor)
}
