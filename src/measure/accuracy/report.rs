//! What a run found out, as it is written to files.

use std::collections::BTreeMap;

use serde::Serialize;

use super::column::Settings;
use super::tally::Tally;
use crate::error::{Kind, Result};
use crate::measure::accuracy::Column;
use crate::measure::result::Machine;
use crate::monitor::Monitor;

/// Changes when a reader of older files would misunderstand newer ones.
pub const VERSION: u32 = 1;

/// Results of one run of `lightpath accuracy`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Format of the file: [`VERSION`] when it was written.
    pub version: u32,
    /// The machine that the run took place on.
    pub machine: Option<Machine>,
    /// Of all random rays.
    pub seed: u64,
    /// How many times the rays of the quick run.
    pub times: u64,
    /// What was measured, in the order of every row's entries.
    pub columns: Vec<ColumnReport>,
    /// One row for each case, in the order of the catalogue.
    pub rows: Vec<Row>,
}

/// A backend in one mode.
#[derive(Debug, Clone, Serialize)]
pub struct ColumnReport {
    /// Name of the backend with its mode.
    pub name: String,
    /// Name and version of what does the work.
    pub version: String,
    /// Instruction set in use.
    pub isa: String,
    /// Whether missing a mark fails the run.
    pub must_hold: bool,
    /// The bound that explains answers unlike the exact ones, in units of that of the shear.
    pub bound: f64,
}

/// Results of one case.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The part of the catalogue.
    pub group: String,
    /// Name of the case, unique in the catalogue.
    pub name: String,
    /// What is traced and what must come out.
    pub what: String,
    /// Criterion that a backend must meet to pass, in words.
    pub mark: String,
    /// What else there is to say.
    pub note: Option<String>,
    /// Answers that the fastest columns gave.
    pub rays: u64,
    /// Results of each column, in the order of [`Report::columns`].
    pub entries: Vec<Entry>,
    /// Of the whole case: building, tracing, judging.
    pub seconds: f64,
    /// Pictures of failures, not written to JSON.
    #[serde(skip)]
    pub pictures: Vec<Picture>,
}

/// A column in a row.
#[derive(Debug, Clone, Serialize)]
pub struct Entry {
    /// Answers that were judged.
    pub rays: u64,
    /// Number of wrong answers.
    pub failed: u64,
    /// Number of wrong answers by [`super::Kind`], under its name.
    pub failures: BTreeMap<String, u64>,
    /// Unlike the exact answer, but within the bound of the backend's own test.
    pub within_bound: u64,
    /// Answers that a case counts without failing it.
    pub counted: u64,
    /// Hits whose t was held against the exact one.
    pub measured: u64,
    /// More than 2 f32 ulp off.
    pub beyond_2_ulp: u64,
    /// More than 8 f32 ulp off.
    pub beyond_8_ulp: u64,
    /// Largest error of t; `None` where none was measured.
    pub worst_ulp: Option<f64>,
    /// Largest distance of the refined point from the exact one, relative to the largest of
    /// its coordinates, those of the primitive, and its distance from the ray's origin.
    pub worst_relative: Option<f64>,
    /// Largest error of a refined barycentric weight.
    pub worst_weight: Option<f64>,
    /// Spent in the backend, summed over threads.
    pub seconds: f64,
    /// Why the mark is missed, of a column that must hold.
    pub missed: Option<String>,
}

impl Entry {
    pub(super) fn new(tally: &Tally, missed: Option<String>) -> Self {
        let measured = tally.measured > 0;
        Self {
            rays: tally.rays,
            failed: tally.failed(),
            failures: tally.failures.iter().map(|(kind, n)| (kind.name().into(), *n)).collect(),
            within_bound: tally.within_bound,
            counted: tally.counted,
            measured: tally.measured,
            beyond_2_ulp: tally.beyond_2,
            beyond_8_ulp: tally.beyond_8,
            worst_ulp: Some(tally.worst_ulp).filter(|_| measured),
            worst_relative: Some(tally.worst_relative).filter(|_| measured),
            worst_weight: Some(tally.worst_weight).filter(|_| measured),
            seconds: tally.nanoseconds as f64 * 1e-9,
            missed,
        }
    }
}

/// Failures of one column over the image.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Index of the column.
    pub column: usize,
    /// Name of the column.
    pub name: String,
    /// Content of the PNG file.
    pub png: Vec<u8>,
}

impl Report {
    /// Creates a report without rows. Builds every column once to learn its version.
    pub(super) fn new(settings: &Settings, monitor: &Monitor) -> Result<Self> {
        let empty = super::meshes::geometry(vec![], vec![], vec![]);
        let mut columns = Vec::new();
        for column in &settings.columns {
            let info = column.build(&empty, 1, monitor)?.info();
            columns.push(ColumnReport {
                name: column.name().into(),
                version: info.version,
                isa: info.isa,
                must_hold: column.must_hold(),
                bound: column.factor(),
            });
        }
        let (seed, times) = (settings.seed, settings.times);
        Ok(Self { version: VERSION, machine: None, seed, times, columns, rows: Vec::new() })
    }

    /// Why the run fails, one sentence each; none if it does not.
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

/// The columns that can be built here, and why the others cannot.
///
/// # Errors
/// Other problems than that a backend does not run here.
pub fn available(columns: Vec<Column>, monitor: &Monitor) -> Result<(Vec<Column>, Vec<String>)> {
    let empty = super::meshes::geometry(vec![], vec![], vec![]);
    let (mut built, mut without) = (Vec::new(), Vec::new());
    for column in columns {
        let problem = column.build(&empty, 1, monitor).err();
        match problem {
            None => built.push(column),
            Some(error) if error.kind == Kind::Unsupported => {
                without.push(format!("without `{}`: {error}", column.name()));
            }
            Some(error) => return Err(error),
        }
    }
    Ok((built, without))
}
