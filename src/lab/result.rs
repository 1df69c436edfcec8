//! Results of `lightpath bench`, as they are written to JSON and read back.
//!
//! `serde(expecting)` gives the text in messages about bad files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::agreement::Agreement;
use super::stats::{Estimate, mad, median_interval, paired_ratio};

/// Version of the file format. It changes if a reader of older files would misread newer ones.
pub const VERSION: u32 = 1;

/// Results of one run of `lightpath bench`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "struct Report")]
pub struct BenchReport {
    /// Format of the file: [`VERSION`] when it was written.
    pub version: u32,
    /// The machine that the run took place on.
    pub machine: Machine,
    /// Time and command line of the run; empty if an older file lacks them.
    #[serde(default)]
    pub run: RunStamp,
    /// One entry for each scene, in the order of the command line.
    pub scenes: Vec<SceneResult>,
}

/// Machine and program versions of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Model name of the processor.
    pub cpu: String,
    /// Number of processors that this process may use.
    pub cores: usize,
    /// Instruction set of our own kernels. A backend such as `bvh:avx2` uses the one it names.
    pub isa: String,
    /// Versions of the program and its compiler, by name.
    pub versions: BTreeMap<String, String>,
}

/// Time and command line of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "struct Run")]
pub struct RunStamp {
    /// Start, in seconds since 1970, UTC.
    pub unix_seconds: u64,
    /// The command line, without the program.
    pub command: Vec<String>,
}

/// Results of one scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// Name of the scene, as on the command line.
    pub name: String,
    /// SHA-256 of the canonical scene.
    pub hash: String,
    /// Number of triangles, of meshes and single ones. Planes and spheres are not counted.
    pub triangles: u64,
    /// Number of recorded rays of each class.
    pub rays: BTreeMap<String, u64>,
    /// The compared backends. Ratios refer to the first.
    pub backends: Vec<BackendResult>,
    /// Timings of builds, rays and whole pictures.
    pub rows: Vec<TimingRow>,
    /// Agreement of the answers of every pair of backends.
    pub agreement: Vec<PairResult>,
}

/// Version, memory and wrong answers of a backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BackendResult {
    /// Name of the backend, as on the command line.
    pub name: String,
    /// Name and version of the code that finds the hits.
    pub version: String,
    /// Instruction set in use.
    pub isa: String,
    /// Bytes held after the build.
    pub bytes: u64,
    /// Largest number of bytes held during the build.
    pub peak_bytes: u64,
    /// Number of provably wrong answers over all rays.
    pub wrong: u64,
}

/// Kind of work that a row times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WorkKind {
    /// A build of the accelerator. Its work is counted in primitives: triangles, spheres, and two
    /// for each plane.
    Build,
    /// Queries of one class of rays. Their work is counted in rays.
    Rays,
    /// A whole picture by the renderer. Its work is counted in traced rays.
    Image,
}

/// Timings of one piece of work by every backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "struct Row")]
pub struct TimingRow {
    /// Kind of work that is timed.
    pub what: WorkKind,
    /// `build`, `image` or a class of rays.
    pub name: String,
    /// `single` or `packets` for rays; empty otherwise.
    pub mode: String,
    /// Number of worker threads.
    pub threads: usize,
    /// One entry for each backend, in the order of [`SceneResult::backends`].
    pub entries: Vec<TimingEntry>,
}

/// Timings of one backend in one row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "struct Entry")]
pub struct TimingEntry {
    /// Number of primitives or rays of one sample.
    pub work: u64,
    /// Seconds of every sample. Samples k of all backends were taken next to each other.
    pub seconds: Vec<f64>,
    /// Median of `seconds` with its interval.
    pub median_s: Estimate,
    /// Median absolute deviation of `seconds`, not scaled.
    pub mad_s: f64,
    /// Millions of rays or primitives per second.
    pub rate: Estimate,
    /// Speed relative to the first backend, above 1 if faster; `None` for the first.
    pub ratio: Option<Estimate>,
    /// Number of rays that hit something or are occluded.
    pub hits: Option<u64>,
    /// Number of provably wrong answers.
    pub wrong: Option<u64>,
    /// Nodes visited per ray.
    pub nodes_per_ray: Option<f64>,
    /// Primitives tested per ray.
    pub primitives_per_ray: Option<f64>,
}

/// Agreement of two backends on the rays of one class and mode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairResult {
    /// Name of the class of rays.
    pub name: String,
    /// How rays are traced: `single` or `packets`.
    pub mode: String,
    /// Names of the two backends.
    pub backends: [String; 2],
    /// Counts of rays by how the two answers compare.
    pub agreement: Agreement,
}

impl TimingEntry {
    /// Creates an entry from the samples of its backend and of the first backend.
    pub fn new(work: u64, seconds: Vec<f64>, first: Option<&[f64]>) -> Self {
        let median_s = median_interval(&seconds);
        Self {
            work,
            median_s,
            mad_s: mad(&seconds),
            rate: median_s.rate(work as f64 / 1e6),
            ratio: first.map(|first| paired_ratio(first, &seconds)),
            hits: None,
            wrong: None,
            nodes_per_ray: None,
            primitives_per_ray: None,
            seconds,
        }
    }
}

impl TimingRow {
    /// Name for tables: `primary, packets` or `build`.
    pub fn label(&self) -> String {
        match self.mode.is_empty() {
            true => self.name.clone(),
            false => format!("{}, {}", self.name, self.mode),
        }
    }

    /// Creates a row from the samples of all backends. The first backend is the reference.
    pub fn new(
        what: WorkKind,
        name: &str,
        mode: &str,
        threads: usize,
        work: &[u64],
        samples: Vec<Vec<f64>>,
    ) -> Self {
        let first = samples[0].clone();
        let entry = |(i, (seconds, work)): (usize, (Vec<f64>, &u64))| {
            TimingEntry::new(*work, seconds, (i > 0).then_some(&first))
        };
        let entries = samples.into_iter().zip(work).enumerate().map(entry).collect();
        Self { what, name: name.into(), mode: mode.into(), threads, entries }
    }
}

/// Speed ratio of two backends in one run that chance may cause. The interval of a ratio covers the
/// scatter of times, not what stays the same in a process, as the places in memory. The same
/// kernels as two backends differed by up to 1.03.
pub const SAME_RUN: f64 = 1.03;

/// Speed ratio of two runs that chance may cause. Runs of one program differed by up to 1.07, and
/// copies of one program file by 1.10.
pub const OTHER_RUN: f64 = 1.1;

impl Estimate {
    /// The conclusion from a speed ratio, in words: a difference must be beyond what chance may
    /// cause, [`SAME_RUN`] or [`OTHER_RUN`].
    pub fn verdict(&self, chance: f64) -> &'static str {
        if self.low > chance {
            "faster"
        } else if self.high < 1.0 / chance {
            "slower"
        } else {
            "no difference shown"
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A run of one scene with the backends `a` and `b`, whose times have this factor.
    pub fn report(factor: f64, hash: &str) -> BenchReport {
        let samples = |t: f64| (0..10).map(|i| factor * t * (1.0 + 0.001 * f64::from(i))).collect();
        let row = TimingRow::new(
            WorkKind::Rays,
            "primary",
            "single",
            1,
            &[1000, 1000],
            vec![samples(2e-3), samples(1e-3)],
        );
        let backend = |name: &str| BackendResult {
            name: name.into(),
            version: String::new(),
            isa: String::new(),
            bytes: 1,
            peak_bytes: 2,
            wrong: 0,
        };
        let scene = SceneResult {
            name: "s".into(),
            hash: hash.into(),
            triangles: 1,
            rays: BTreeMap::new(),
            backends: vec![backend("a"), backend("b")],
            rows: vec![row],
            agreement: vec![],
        };
        let machine =
            Machine { cpu: "c".into(), cores: 1, isa: "i".into(), versions: BTreeMap::new() };
        BenchReport { version: VERSION, machine, run: RunStamp::default(), scenes: vec![scene] }
    }

    #[test]
    fn what_chance_may_cause_is_no_difference() {
        let verdict = |low, high| Estimate { value: 1.0, low, high }.verdict(1.03);
        assert_eq!(verdict(1.031, 1.2), "faster");
        assert_eq!(verdict(0.8, 0.97), "slower");
        for (low, high) in [(1.029, 1.2), (0.8, 0.972), (1.01, 1.02), (f64::NAN, f64::NAN)] {
            assert_eq!(verdict(low, high), "no difference shown", "{low} {high}");
        }
    }

    #[test]
    fn ratios_refer_to_the_first_backend() {
        let report = report(1.0, "h");
        let [a, b] = [0, 1].map(|i| &report.scenes[0].rows[0].entries[i]);
        assert_eq!(a.ratio, None);
        let ratio = b.ratio.unwrap();
        assert!((ratio.value - 2.0).abs() < 1e-12 && ratio.verdict(SAME_RUN) == "faster");
        // 1000 rays in 1 ms are a million rays per second.
        assert!((b.rate.value - 1.0).abs() < 0.01, "{:?}", b.rate);
        assert!(b.rate.low < b.rate.value && b.rate.value < b.rate.high);
    }

    #[test]
    fn a_report_is_the_same_after_writing_and_reading() {
        let report = report(1.0 / 3.0, "h");
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<BenchReport>(&text).unwrap(), report);
    }
}
