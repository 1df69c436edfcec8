//! Results of `lightpath accuracy`, as they are written to JSON.

use std::collections::BTreeMap;

use serde::Serialize;

use super::counts::CaseCounts;
use super::settings::AccuracySettings;
use crate::error::Result;
use crate::lab::backend::empty_geometry;
use crate::lab::result::Machine;
use crate::monitor::Monitor;

/// Version of the file format. It changes if a reader of older files would misread newer ones.
pub const VERSION: u32 = 1;

/// Results of one run of `lightpath accuracy`.
#[derive(Debug, Clone, Serialize)]
pub struct AccuracyReport {
    /// Format of the file: [`VERSION`] when it was written.
    pub version: u32,
    /// The machine that the run took place on; `None` until the caller sets it.
    pub machine: Option<Machine>,
    /// Seed of all random rays.
    pub seed: u64,
    /// Number of rays, in multiples of the quick run.
    pub times: u64,
    /// The tested backends, in the order of every row's entries.
    pub columns: Vec<ColumnReport>,
    /// One row for each case, in the order of the catalogue.
    pub rows: Vec<CaseResult>,
}

/// Name, version and error bound of a tested backend.
#[derive(Debug, Clone, Serialize)]
pub struct ColumnReport {
    /// Name of the backend with its mode.
    pub name: String,
    /// Name and version of the code that finds the hits.
    pub version: String,
    /// Instruction set in use.
    pub isa: String,
    /// Whether the run fails if the backend does not meet a pass criterion.
    pub must_be_right: bool,
    /// Error bound within which an answer may differ from the exact one, in units of the bound of
    /// `bvh`'s test.
    pub bound: f64,
}

/// Results of one case.
#[derive(Debug, Clone, Serialize)]
pub struct CaseResult {
    /// Name of the part of the catalogue.
    pub group: String,
    /// Name of the case, unique in the catalogue.
    pub name: String,
    /// Description of the rays and of the right answers.
    pub what: String,
    /// Criterion that a backend must meet to pass, in words.
    pub mark: String,
    /// Remark for the table.
    pub note: Option<String>,
    /// Largest number of judged answers of a backend.
    pub rays: u64,
    /// Results of each backend, in the order of [`AccuracyReport::columns`].
    pub entries: Vec<BackendCounts>,
    /// Seconds for the whole case: builds, tracing and judging.
    pub seconds: f64,
    /// Pictures of failures, not written to JSON.
    #[serde(skip)]
    pub pictures: Vec<FailurePicture>,
}

/// Results of one backend in one case.
#[derive(Debug, Clone, Serialize)]
pub struct BackendCounts {
    /// Number of judged answers.
    pub rays: u64,
    /// Number of wrong answers.
    pub failed: u64,
    /// Number of wrong answers by [`super::WrongKind`], under its name.
    pub failures: BTreeMap<String, u64>,
    /// Answers that differ from the exact one within the error bound of the backend's own test.
    pub within_bound: u64,
    /// Hits that are as near as the lowest primitive but on another one, of backends that do not
    /// promise the lowest. They are not wrong.
    pub ties: u64,
    /// Answers that a case counts without failing it.
    pub counted: u64,
    /// Number of hits whose t was compared with the exact t.
    pub measured: u64,
    /// Number of these hits with t off by more than 2 f32 ulp.
    pub beyond_2_ulp: u64,
    /// Number of these hits with t off by more than 8 f32 ulp.
    pub beyond_8_ulp: u64,
    /// Largest error of t in f32 ulp; `None` if none was measured.
    pub worst_ulp: Option<f64>,
    /// Largest error of a refined point, relative to its scale.
    ///
    /// The scale is the largest of the point's coordinates, the primitive's coordinates (not for
    /// the group `spheres`), and the distance between point and ray origin.
    pub worst_relative: Option<f64>,
    /// Largest error of a refined barycentric weight.
    pub worst_weight: Option<f64>,
    /// Seconds spent in the backend, summed over threads.
    pub seconds: f64,
    /// Reason why the backend fails the run; `None` if it does not.
    pub missed: Option<String>,
}

impl BackendCounts {
    pub(super) fn new(counts: &CaseCounts, missed: Option<String>) -> Self {
        let measured = counts.measured > 0;
        Self {
            rays: counts.rays,
            failed: counts.failed(),
            failures: counts.failures.iter().map(|(kind, n)| (kind.name().into(), *n)).collect(),
            within_bound: counts.within_bound,
            ties: counts.ties,
            counted: counts.counted,
            measured: counts.measured,
            beyond_2_ulp: counts.beyond_2,
            beyond_8_ulp: counts.beyond_8,
            worst_ulp: Some(counts.worst_ulp).filter(|_| measured),
            worst_relative: Some(counts.worst_relative).filter(|_| measured),
            worst_weight: Some(counts.worst_weight).filter(|_| measured),
            seconds: counts.nanoseconds as f64 * 1e-9,
            missed,
        }
    }
}

/// Picture of a geometry with the failures of one backend.
#[derive(Debug, Clone)]
pub struct FailurePicture {
    /// Index of the backend in the settings.
    pub column: usize,
    /// Name of the backend.
    pub name: String,
    /// Content of the PNG file.
    pub png: Vec<u8>,
}

impl AccuracyReport {
    /// Creates a report without rows. Builds every backend once to learn its version.
    pub(super) fn new(settings: &AccuracySettings, monitor: &Monitor) -> Result<Self> {
        let empty = empty_geometry();
        let mut columns = Vec::new();
        for backend in &settings.tested_backends {
            let info = backend.build(&empty, 1, monitor)?.info();
            columns.push(ColumnReport {
                name: backend.name.clone(),
                version: info.version,
                isa: info.isa,
                must_be_right: backend.must_be_right(),
                bound: backend.error_factor(),
            });
        }
        let (seed, times) = (settings.seed, settings.times);
        Ok(Self { version: VERSION, machine: None, seed, times, columns, rows: Vec::new() })
    }

    /// The rows of each group.
    pub fn groups(&self) -> impl Iterator<Item = &[CaseResult]> {
        self.rows.chunk_by(|a, b| a.group == b.group)
    }

    /// Number of judged answers.
    pub fn answers(&self) -> u64 {
        self.rows.iter().flat_map(|row| &row.entries).map(|entry| entry.rays).sum()
    }

    /// Reasons why the run fails, one line each. Empty if it passes.
    pub fn failures(&self) -> Vec<String> {
        let mut failures = Vec::new();
        for row in &self.rows {
            for (column, entry) in self.columns.iter().zip(&row.entries) {
                if let Some(missed) = &entry.missed {
                    failures
                        .push(format!("{}: {}: {}: {missed}", row.group, row.name, column.name));
                }
            }
        }
        failures
    }
}
