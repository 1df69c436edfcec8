//! What `bench` found out, as it is written to files and read back.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::answers::Agreement;
use super::stats::{Estimate, mad, median_interval, paired_ratio, unpaired_ratio};
use crate::units::plural;

/// Changes when a reader of older files would misunderstand newer ones.
pub const VERSION: u32 = 1;

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`VERSION`].
    pub version: u32,
    /// Where it ran.
    pub machine: Machine,
    /// When, and of what command; of an older file nothing.
    #[serde(default)]
    pub run: Run,
    /// In the order of the command line.
    pub scenes: Vec<SceneResult>,
}

/// Where a run took place, and what ran.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Model name of the processor.
    pub cpu: String,
    /// Processors that this process may use.
    pub cores: usize,
    /// Instruction set of our own kernels, unless a backend says otherwise.
    pub isa: String,
    /// Of the program and its compiler.
    pub versions: BTreeMap<String, String>,
}

/// When a run took place, and of what command.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Start, in seconds since 1970, UTC.
    pub unix_seconds: u64,
    /// The command line, without the program.
    pub command: Vec<String>,
}

/// One scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// As on the command line.
    pub name: String,
    /// SHA-256 of the canonical scene.
    pub hash: String,
    /// Of all meshes and single triangles; a plane counts as two.
    pub triangles: u64,
    /// Rays recorded, by class.
    pub rays: BTreeMap<String, u64>,
    /// What was compared; the first is what ratios refer to.
    pub backends: Vec<BackendResult>,
    /// What was timed.
    pub rows: Vec<Row>,
    /// How far the answers of every pair agree.
    pub agreement: Vec<PairResult>,
}

/// A backend and what it holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BackendResult {
    /// As on the command line.
    pub name: String,
    /// Of what does the work.
    pub version: String,
    /// Instruction set in use.
    pub isa: String,
    /// Bytes held after the build.
    pub bytes: u64,
    /// Most bytes held during the build.
    pub peak_bytes: u64,
    /// Provably wrong answers over all rays.
    pub wrong: u64,
}

/// What is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum What {
    /// Building the accelerator; work in triangles.
    Build,
    /// Queries of one class of rays; work in rays.
    Rays,
    /// A whole picture by the renderer; work in the rays it traced.
    Image,
}

/// One thing, done by every backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What.
    pub what: What,
    /// `build`, `image` or a class of rays.
    pub name: String,
    /// `single` or `packets`; empty but for rays.
    pub mode: String,
    /// Worker threads.
    pub threads: usize,
    /// In the order of [`SceneResult::backends`].
    pub entries: Vec<Entry>,
}

/// What one backend did in one row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Triangles or rays per sample.
    pub work: u64,
    /// Every sample; sample k of all backends ran next to each other.
    pub seconds: Vec<f64>,
    /// Median and its interval.
    pub median_s: Estimate,
    /// Median absolute deviation.
    pub mad_s: f64,
    /// Work per microsecond: Mray/s, Mtri/s.
    pub rate: Estimate,
    /// How many times as fast as the first backend; `None` for the first.
    pub ratio: Option<Estimate>,
    /// Rays that met something.
    pub hits: Option<u64>,
    /// Provably wrong answers.
    pub wrong: Option<u64>,
    /// Nodes visited per ray.
    pub nodes_per_ray: Option<f64>,
    /// Primitives tested per ray.
    pub primitives_per_ray: Option<f64>,
}

/// Two backends on the rays of one row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairResult {
    /// The class of rays.
    pub name: String,
    /// `single` or `packets`.
    pub mode: String,
    /// Names of both.
    pub backends: [String; 2],
    /// How they compare.
    pub agreement: Agreement,
}

impl Entry {
    /// An entry from its samples and those of the first backend.
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

impl Row {
    /// `primary, packets`, `build`.
    pub fn label(&self) -> String {
        match self.mode.is_empty() {
            true => self.name.clone(),
            false => format!("{}, {}", self.name, self.mode),
        }
    }

    /// Entries from the samples of all backends, the first of which is the reference.
    pub fn new(
        what: What,
        name: &str,
        mode: &str,
        threads: usize,
        work: &[u64],
        samples: Vec<Vec<f64>>,
    ) -> Self {
        let first = samples[0].clone();
        let entry = |(i, (seconds, work)): (usize, (Vec<f64>, &u64))| {
            Entry::new(*work, seconds, (i > 0).then_some(&first))
        };
        let entries = samples.into_iter().zip(work).enumerate().map(entry).collect();
        Self { what, name: name.into(), mode: mode.into(), threads, entries }
    }
}

impl Estimate {
    /// What a ratio says, in words.
    pub fn verdict(&self) -> &'static str {
        match (self.holds_one(), self.value > 1.0) {
            (true, _) => "no difference shown",
            (_, true) => "faster",
            (_, false) => "slower",
        }
    }
}

/// A row of this run against the same of an earlier one.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Scene, row and backend.
    pub scene: String,
    /// As [`Row::label`].
    pub row: String,
    /// Worker threads.
    pub threads: usize,
    /// Name of the backend.
    pub backend: String,
    /// How many times as fast as then.
    pub ratio: Estimate,
}

/// What has changed since an earlier run.
#[derive(Debug, Clone)]
pub struct Since {
    /// Its file, and of which commit it was.
    pub baseline: String,
    /// How its machine differs from this one.
    pub elsewhere: Option<String>,
    /// Of what both have: the same scene (by name and content), row and backend.
    pub changes: Vec<Change>,
}

impl Since {
    /// Between `then`, which stands in the file `name`, and now.
    pub fn new(now: &Report, name: &str, then: &Report) -> Self {
        let commit = then.machine.versions.get("commit").map_or("unknown", String::as_str);
        Self {
            baseline: format!("{name}, commit {commit}"),
            elsewhere: elsewhere(now, then),
            changes: changes(now, then),
        }
    }
}

/// How the machine or the kernels of two runs differ; `None` if they do not.
fn elsewhere(now: &Report, then: &Report) -> Option<String> {
    let (a, b) = (&now.machine, &then.machine);
    let pairs = [(&a.cpu, &b.cpu), (&a.isa, &b.isa)];
    let cores = [a.cores, b.cores].map(|n| plural(n, "processor"));
    let pairs = pairs.into_iter().chain([(&cores[0], &cores[1])]);
    let different: Vec<String> =
        pairs.filter(|(a, b)| a != b).map(|(a, b)| format!("{b} then, {a} now")).collect();
    (!different.is_empty()).then(|| different.join("; "))
}

/// All that two runs have in common: the same scene (by name and content), row and backend.
fn changes(now: &Report, then: &Report) -> Vec<Change> {
    let mut changes = Vec::new();
    for scene in &now.scenes {
        let same = |s: &&SceneResult| s.name == scene.name && s.hash == scene.hash;
        let Some(old) = then.scenes.iter().find(same) else { continue };
        for row in &scene.rows {
            let key = |r: &Row| (r.what as u8, r.name.clone(), r.mode.clone(), r.threads);
            let Some(old_row) = old.rows.iter().find(|r| key(r) == key(row)) else { continue };
            for (backend, entry) in scene.backends.iter().zip(&row.entries) {
                let index = old.backends.iter().position(|b| b.name == backend.name);
                let Some(old_entry) = index.and_then(|i| old_row.entries.get(i)) else { continue };
                // Per unit of work: the number of rays may be another one.
                let unit = |e: &Entry| -> Vec<f64> {
                    e.seconds.iter().map(|s| s / e.work.max(1) as f64).collect()
                };
                changes.push(Change {
                    scene: scene.name.clone(),
                    row: row.label(),
                    threads: row.threads,
                    backend: backend.name.clone(),
                    ratio: unpaired_ratio(&unit(old_entry), &unit(entry)),
                });
            }
        }
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(factor: f64, hash: &str) -> Report {
        let samples = |t: f64| (0..10).map(|i| factor * t * (1.0 + 0.001 * f64::from(i))).collect();
        let row = Row::new(
            What::Rays,
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
        Report { version: VERSION, machine, run: Run::default(), scenes: vec![scene] }
    }

    #[test]
    fn entries_are_compared_with_the_first() {
        let report = report(1.0, "h");
        let [a, b] = [0, 1].map(|i| &report.scenes[0].rows[0].entries[i]);
        assert_eq!(a.ratio, None);
        let ratio = b.ratio.unwrap();
        assert!((ratio.value - 2.0).abs() < 1e-12 && ratio.verdict() == "faster");
        // 1000 rays in 1 ms are a million a second.
        assert!((b.rate.value - 1.0).abs() < 0.01, "{:?}", b.rate);
        assert!(b.rate.low < b.rate.value && b.rate.value < b.rate.high);
    }

    #[test]
    fn every_digit_survives_the_file() {
        let report = report(1.0 / 3.0, "h");
        let text = serde_json::to_string(&report).unwrap();
        assert_eq!(serde_json::from_str::<Report>(&text).unwrap(), report);
    }

    #[test]
    fn another_machine_is_told() {
        let (now, mut then) = (report(1.0, "h"), report(1.0, "h"));
        assert_eq!(elsewhere(&now, &then), None);
        then.machine.versions.clear();
        assert_eq!(elsewhere(&now, &then), None);
        then.machine.cpu = "another".into();
        then.machine.cores += 1;
        let told = elsewhere(&now, &then).unwrap();
        assert!(
            told.contains("another then") && told.contains("2 processors then, 1 processor now"),
            "{told}"
        );
    }

    #[test]
    fn changes_are_of_the_same_scene() {
        let changed = changes(&report(0.5, "h"), &report(1.0, "h"));
        assert_eq!(changed.len(), 2);
        for change in &changed {
            assert!((change.ratio.value - 2.0).abs() < 1e-9, "{change:?}");
            assert_eq!(change.ratio.verdict(), "faster");
        }
        let same = changes(&report(1.0, "h"), &report(1.0, "h"));
        assert!(same.iter().all(|change| change.ratio.verdict() == "no difference shown"));
        assert_eq!(changes(&report(1.0, "h"), &report(1.0, "other")), []);
    }
}
