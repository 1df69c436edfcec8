//! Results of `lightpath crosscheck`, as they are printed and saved.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::check::{CrossCheck, PacketVerdicts};
use super::known;
use super::pictures::PictureReport;
use crate::accel::BuildInfo;
use crate::accel::bvh::TreeStats;
use crate::lab::answer::Answer;
use crate::lab::backend::{BuiltBackend, must_be_right};
use crate::lab::query::QueryPacket;
use crate::lab::rays::PacketToTrace;
use crate::lab::verdict::Verdict;
use crate::ray::{Coherence, LANES, Mask, NONE, Rays};
use crate::scene::Backend;

/// Numbers of answers by verdict.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VerdictCounts {
    /// Number of answers that were judged.
    pub rays: u64,
    /// Number of answers of each verdict.
    #[serde(flatten)]
    pub of: BTreeMap<Verdict, u64>,
}

impl Default for VerdictCounts {
    fn default() -> Self {
        Self { rays: 0, of: Verdict::ALL.map(|verdict| (verdict, 0)).into() }
    }
}

impl VerdictCounts {
    /// Counts the verdict on one answer.
    pub fn count(&mut self, verdict: Verdict) {
        self.rays += 1;
        *self.of.entry(verdict).or_default() += 1;
    }

    /// Number of wrong answers.
    pub fn wrong(&self) -> u64 {
        self.of.iter().filter(|(verdict, _)| verdict.is_wrong()).map(|(_, count)| count).sum()
    }
}

/// All verdicts on one backend.
#[derive(Debug, Clone, Default, Serialize)]
pub struct BackendReport {
    /// Name of the backend.
    pub backend: String,
    /// Name and version of the code that finds the hits.
    pub version: String,
    /// Instruction set in use.
    pub isa: String,
    /// Error bound of the backend's own test, in units of the bound of `bvh`'s test.
    pub bound: f64,
    /// Name and verdicts of each source of rays, in the order of the check.
    pub sources: Vec<(String, VerdictCounts)>,
    /// Verdicts of all sources and modes together.
    pub total: VerdictCounts,
    /// Whether a wrong answer fails the check.
    pub must_be_right: bool,
    /// Largest number of wrong answers for each of `sources`. Empty if all answers must be right.
    pub allowed: Vec<u64>,
}

impl BackendReport {
    /// Counts the verdict on an answer to a ray of `source`. Sources must come one after the other.
    fn count(&mut self, source: &str, verdict: Verdict) {
        self.total.count(verdict);
        if self.sources.last().is_none_or(|(last, _)| last != source) {
            self.sources.push((source.into(), VerdictCounts::default()));
        }
        if let Some((_, counts)) = self.sources.last_mut() {
            counts.count(verdict);
        }
    }

    /// Sets `allowed` from the known rates of the backend.
    fn allow(&mut self, backend: Backend) {
        let most = |(source, counts): &(String, VerdictCounts)| {
            known::rate(backend, source).map(|rate| known::most(rate, counts.rays).min(counts.rays))
        };
        self.allowed = self.sources.iter().filter_map(most).collect();
    }

    fn failures(&self) -> Vec<String> {
        let (name, wrong, rays) = (&self.backend, self.total.wrong(), self.total.rays);
        if self.must_be_right {
            let failure = || format!("`{name}` gives wrong answers to {wrong} of {rays} rays");
            return (wrong > 0).then(failure).into_iter().collect();
        }
        let sources = self.sources.iter().zip(&self.allowed);
        let above = sources.filter(|((_, counts), most)| counts.wrong() > **most);
        let failure = |((source, counts), most): (&(String, VerdictCounts), &u64)| {
            let (wrong, rays) = (counts.wrong(), counts.rays);
            format!(
                "`{name}` gives wrong answers to {wrong} of {rays} {source} rays, more than the known {most}"
            )
        };
        above.map(failure).collect()
    }
}

/// Result of [`Bvh::validate`].
///
/// [`Bvh::validate`]: crate::accel::bvh::Bvh::validate
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TreeReport {
    /// The tree has all properties that the builder promises. The text describes its content.
    Valid(String),
    /// The tree lacks a property that the builder promises, which the text describes.
    Invalid(String),
}

impl From<Result<TreeStats, String>> for TreeReport {
    fn from(validated: Result<TreeStats, String>) -> Self {
        validated.map_or_else(Self::Invalid, |stats| Self::Valid(stats.to_string()))
    }
}

/// Comparison of the trees of `coursework` with a loop over all its tests.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct PlainLoop {
    /// Number of rays compared.
    pub rays: u64,
    /// Number of rays whose answers differ.
    pub wrong: u64,
}

/// A ray in the JSON of a finding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedRay {
    /// Lane of the ray in its packet.
    pub lane: usize,
    /// Origin, relative to the scene's origin.
    pub origin: [f32; 3],
    /// Direction, of any length but zero.
    pub direction: [f32; 3],
    /// Start of the segment.
    pub tnear: f32,
    /// End of the segment; `None` is infinity.
    pub tfar: Option<f32>,
    /// Index of the primitive that the ray leaves, if any.
    pub leaving: Option<u32>,
}

/// A wrong answer with all that reproduces it in the same scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finding {
    /// Name of the backend that answered.
    pub backend: String,
    /// Source of the right answer: `oracle` or `plain loop`.
    pub against: String,
    /// Kind of the error.
    pub verdict: Verdict,
    /// How the packet was traced.
    pub mode: Coherence,
    /// Name of the source of the rays.
    pub source: String,
    /// Whether the query is `occluded`, not `closest`.
    pub shadow: bool,
    /// Lane of the wrong answer.
    pub lane: usize,
    /// The wrong answer of the backend.
    pub answer: Answer,
    /// The oracle's or the plain loop's answer.
    pub truth: Answer,
    /// All rays of the packet, because the other rays may influence the answer.
    pub packet: Vec<SavedRay>,
}

impl Finding {
    /// Restores the packet and its query.
    ///
    /// # Errors
    /// A message that describes an invalid packet.
    pub fn case(&self) -> Result<QueryPacket, String> {
        let (mut active, mut rays) = (Mask::NONE, Rays::EMPTY);
        for ray in &self.packet {
            let i = ray.lane;
            if i >= LANES {
                return Err(format!("found lane {i}, expected 0 to {}", LANES - 1));
            }
            active.0[i] = -1;
            rays.set(i, ray.origin.into(), ray.direction.into());
            rays.tnear[i] = ray.tnear;
            rays.tfar[i] = ray.tfar.unwrap_or(f32::INFINITY);
            rays.leaving[i] = ray.leaving.unwrap_or(NONE);
        }
        if self.lane >= LANES || active.0[self.lane] == 0 {
            return Err(format!("found the wrong answer in lane {}, which has no ray", self.lane));
        }
        if rays.possible(&active) != active {
            return Err("found a ray without direction, or one that is not finite".into());
        }
        let coherence = match self.mode {
            Coherence::Coherent => Coherence::Coherent,
            Coherence::Incoherent | Coherence::Unordered | Coherence::Single => {
                Coherence::Unordered
            }
        };
        let packet = PacketToTrace { active, rays };
        Ok(QueryPacket { source: self.source.clone(), shadow: self.shadow, coherence, packet })
    }

    /// Returns whether the finding fails a check.
    pub fn fails(&self) -> bool {
        self.against != "oracle" || must_be_right(&self.backend)
    }
}

fn saved(case: &QueryPacket) -> Vec<SavedRay> {
    let PacketToTrace { active, rays } = &case.packet;
    crate::accel::lane::lanes(active)
        .map(|i| SavedRay {
            lane: i,
            origin: rays.org.map(|axis| axis[i]),
            direction: rays.dir.map(|axis| axis[i]),
            tnear: rays.tnear[i],
            tfar: Some(rays.tfar[i]).filter(|tfar| tfar.is_finite()),
            leaving: Some(rays.leaving[i]).filter(|&leaving| leaving != NONE),
        })
        .collect()
}

/// All results of a check.
#[derive(Debug, Clone, Default, Serialize)]
pub struct CrosscheckReport {
    /// Seed of all random rays.
    pub seed: i64,
    /// Number of rays, each counted once.
    pub rays: u64,
    /// Number of primitives of the scene.
    pub primitives: u64,
    /// Verdicts on each backend, in the order of the command line.
    pub backends: Vec<BackendReport>,
    /// Result of the validation of `bvh`'s tree, if `bvh` is checked.
    pub tree: Option<TreeReport>,
    /// Comparison of `coursework` with its plain loop, if `coursework` is checked.
    pub plain_loop: Option<PlainLoop>,
    /// The first wrong answers of each backend, verdict and source of rays.
    pub findings: Vec<Finding>,
    /// Comparisons of each picture with the first.
    pub pictures: Vec<PictureReport>,
    #[serde(skip)]
    kept: BTreeMap<(String, String, Verdict, String), usize>,
}

impl CrosscheckReport {
    /// Creates a report without any verdict.
    pub fn new(check: &CrossCheck) -> Self {
        let backends = check.built_backends.iter().map(|built| {
            let BuildInfo { version, isa, .. } = built.accelerator.info();
            BackendReport {
                backend: built.tested.name.clone(),
                version,
                isa,
                bound: built.tested.error_factor(),
                must_be_right: built.tested.must_be_right(),
                ..BackendReport::default()
            }
        });
        Self {
            seed: check.seed,
            primitives: check.world.geometry.count(),
            backends: backends.collect(),
            plain_loop: check.coursework.map(|_| PlainLoop::default()),
            ..Self::default()
        }
    }

    /// Adds the verdicts on a packet. Keeps at most `most` wrong answers of each backend, verdict
    /// and source of rays.
    pub fn add(&mut self, part: &PacketVerdicts, most: usize) {
        let source = &part.case.source;
        self.rays += u64::from(part.case.packet.active.count());
        for &(index, mode, lane, verdict, answer) in &part.verdicts {
            let report = &mut self.backends[index];
            report.count(source, verdict);
            if verdict.is_wrong() {
                let backend = report.backend.clone();
                let who = [&backend, "oracle"];
                self.keep(part, who, (mode, lane, verdict), [answer, part.truths[lane]], most);
            }
        }
        if let Some(plain_loop) = &mut self.plain_loop {
            plain_loop.rays += part.looped;
            plain_loop.wrong += part.loop_mismatches.len() as u64;
        }
        for &(lane, tree, all) in &part.loop_mismatches {
            let verdict = match (tree, all) {
                (Answer::Miss, _) => Verdict::Leak,
                (_, Answer::Miss) => Verdict::FalseHit,
                _ => Verdict::WrongPrimitive,
            };
            let who = [Backend::Coursework.name(), "plain loop"];
            self.keep(part, who, (Coherence::Unordered, lane, verdict), [tree, all], most);
        }
    }

    /// Sets the numbers of wrong answers that known rates allow. All rays must be counted before.
    pub fn allow_known(&mut self, built_backends: &[BuiltBackend]) {
        for (report, built) in self.backends.iter_mut().zip(built_backends) {
            report.allow(built.tested.backend);
        }
    }

    fn keep(
        &mut self,
        part: &PacketVerdicts,
        [backend, against]: [&str; 2],
        (mode, lane, verdict): (Coherence, usize, Verdict),
        [answer, truth]: [Answer; 2],
        most: usize,
    ) {
        let source = part.case.source.clone();
        let kept = self.kept.entry((backend.into(), against.into(), verdict, source)).or_default();
        if *kept >= most {
            return;
        }
        *kept += 1;
        self.findings.push(Finding {
            backend: backend.into(),
            against: against.into(),
            verdict,
            mode,
            source: part.case.source.clone(),
            shadow: part.case.shadow,
            lane,
            answer,
            truth,
            packet: saved(&part.case),
        });
    }

    /// Reasons why the check failed, one sentence each. Empty if it passed.
    pub fn failures(&self) -> Vec<String> {
        let mut failures: Vec<String> =
            self.backends.iter().flat_map(BackendReport::failures).collect();
        if let Some(TreeReport::Invalid(what)) = &self.tree {
            failures.push(format!("the tree of `bvh` is invalid: {what}"));
        }
        if let Some(PlainLoop { rays, wrong: wrong @ 1.. }) = self.plain_loop {
            failures.push(format!(
                "`coursework` answers {wrong} of {rays} rays differently from a plain loop over its tests"
            ));
        }
        failures.extend(self.pictures.iter().filter_map(PictureReport::failure));
        failures
    }
}
