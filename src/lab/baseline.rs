//! Compares a run of `lightpath bench` with an earlier one, the baseline.

use serde::Serialize;

use super::result::{BenchReport, SceneResult, TimingEntry, TimingRow};
use super::stats::{Estimate, unpaired_ratio};
use crate::units::plural;

/// One timing of this run compared with the same timing of an earlier run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Name of the scene.
    pub scene: String,
    /// The row, as [`TimingRow::label`] names it.
    pub row: String,
    /// Number of worker threads.
    pub threads: usize,
    /// Name of the backend.
    pub backend: String,
    /// Speed relative to the earlier run, above 1 if faster now.
    pub ratio: Estimate,
}

/// Comparison of this run with an earlier run, the baseline.
#[derive(Debug, Clone, Serialize)]
pub struct BaselineComparison {
    /// File and commit of the baseline.
    pub baseline: String,
    /// Differences between the two machines, in words; `None` if there are none.
    pub machine_differences: Option<String>,
    /// Changes of all timings that both runs have. Scene (name and content), row, number of threads
    /// and backend must be the same.
    pub changes: Vec<Change>,
    /// What the two runs do not share if `changes` is empty, in words; else `None`.
    pub nothing_shared: Option<String>,
}

impl BaselineComparison {
    /// Compares `now` with `then`, the baseline read from the file `name`.
    pub fn new(now: &BenchReport, name: &str, then: &BenchReport) -> Self {
        let changes = changes(now, then);
        let commit = then.machine.versions.get("commit").map_or("unknown", String::as_str);
        Self {
            baseline: format!("{name}, commit {commit}"),
            machine_differences: machine_differences(now, then),
            nothing_shared: changes.is_empty().then(|| nothing_shared(now, then)),
            changes,
        }
    }
}

/// Describes how the machines or kernels of two runs differ; `None` if they do not.
fn machine_differences(now: &BenchReport, then: &BenchReport) -> Option<String> {
    let (a, b) = (&now.machine, &then.machine);
    let pairs = [(&a.cpu, &b.cpu), (&a.isa, &b.isa)];
    let cores = [a.cores, b.cores].map(|n| plural(n, "processor"));
    let pairs = pairs.into_iter().chain([(&cores[0], &cores[1])]);
    let different: Vec<String> =
        pairs.filter(|(a, b)| a != b).map(|(a, b)| format!("{b} then, {a} now")).collect();
    (!different.is_empty()).then(|| different.join("; "))
}

/// The scenes of the same name and content: now, then.
fn shared_scenes<'a>(
    now: &'a BenchReport,
    then: &'a BenchReport,
) -> impl Iterator<Item = (&'a SceneResult, &'a SceneResult)> {
    now.scenes.iter().filter_map(|scene| {
        let same = |s: &&SceneResult| s.name == scene.name && s.hash == scene.hash;
        Some((scene, then.scenes.iter().find(same)?))
    })
}

/// Describes why two runs have no timing in common.
fn nothing_shared(now: &BenchReport, then: &BenchReport) -> String {
    let Some((scene, old)) = shared_scenes(now, then).next() else {
        return "no scene in common (name and content must be the same)".into();
    };
    let names = |scene: &SceneResult| -> Vec<String> {
        scene.backends.iter().map(|backend| backend.name.clone()).collect()
    };
    let (names, old_names) = (names(scene), names(old));
    if !names.iter().any(|name| old_names.contains(name)) {
        let [then, now] = [old_names, names].map(|names| names.join(", "));
        return format!("no backend in common: {then} then, {now} now");
    }
    "no timing in common (class of rays and number of threads must be the same)".into()
}

/// Compares all timings that two runs have in common.
fn changes(now: &BenchReport, then: &BenchReport) -> Vec<Change> {
    let mut changes = Vec::new();
    for (scene, old) in shared_scenes(now, then) {
        for row in &scene.rows {
            let key = |r: &TimingRow| (r.what as u8, r.name.clone(), r.mode.clone(), r.threads);
            let Some(old_row) = old.rows.iter().find(|r| key(r) == key(row)) else { continue };
            for (backend, entry) in scene.backends.iter().zip(&row.entries) {
                let index = old.backends.iter().position(|b| b.name == backend.name);
                let Some(old_entry) = index.and_then(|i| old_row.entries.get(i)) else { continue };
                // Seconds per unit of work, because the number of rays may differ.
                let unit = |e: &TimingEntry| -> Vec<f64> {
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
    use crate::lab::result::OTHER_RUN;
    use crate::lab::result::tests::report;

    #[test]
    fn a_different_machine_is_described() {
        let (now, mut then) = (report(1.0, "h"), report(1.0, "h"));
        assert_eq!(machine_differences(&now, &then), None);
        then.machine.versions.clear();
        assert_eq!(machine_differences(&now, &then), None);
        then.machine.cpu = "another".into();
        then.machine.cores += 1;
        let text = machine_differences(&now, &then).unwrap();
        assert!(
            text.contains("another then") && text.contains("2 processors then, 1 processor now"),
            "{text}"
        );
    }

    #[test]
    fn only_the_same_scene_is_compared() {
        let changed = changes(&report(0.5, "h"), &report(1.0, "h"));
        assert_eq!(changed.len(), 2);
        for change in &changed {
            assert!((change.ratio.value - 2.0).abs() < 1e-9, "{change:?}");
            assert_eq!(change.ratio.verdict(OTHER_RUN), "faster");
        }
        let same = changes(&report(1.0, "h"), &report(1.0, "h"));
        assert!(same.iter().all(|change| change.ratio.verdict(OTHER_RUN) == "no difference shown"));
        assert_eq!(changes(&report(1.0, "h"), &report(1.0, "other")), []);
    }

    #[test]
    fn what_two_runs_do_not_share_is_named() {
        let said = |then: &BenchReport| {
            BaselineComparison::new(&report(1.0, "h"), "b.json", then).nothing_shared
        };
        assert_eq!(said(&report(1.0, "h")), None);
        let scene = said(&report(1.0, "other")).unwrap();
        assert!(scene.starts_with("no scene in common"), "{scene}");
        let mut then = report(1.0, "h");
        then.scenes[0].backends[0].name = "c".into();
        assert_eq!(said(&then), None);
        then.scenes[0].backends[1].name = "d".into();
        assert_eq!(said(&then).unwrap(), "no backend in common: c, d then, a, b now");
        let mut then = report(1.0, "h");
        then.scenes[0].rows[0].threads = 7;
        assert!(said(&then).unwrap().starts_with("no timing in common"));
    }
}
