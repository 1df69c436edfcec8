//! Hard cases with known answers, traced on every backend, for `lightpath accuracy`.
//!
//! A [`Case`] is a row of the table: its rays, their right answers and its pass criterion, a
//! [`PassCriterion`]. A column of the table is a backend under test, a [`TestedBackend`]. The files
//! `watertight`, `degenerate`, `rays`, `grazing`, `quads`, `contact`, `secondary`, `spheres`,
//! `map_coordinates` and `conservative` build the geometry and aim the rays. [`CaseRun`] traces the
//! rays with every tested backend. `judge` counts wrong answers, unless a case counts them itself.

mod case;
mod conservative;
mod contact;
mod counts;
mod degenerate;
mod grazing;
mod judge;
mod map_coordinates;
pub mod meshes;
mod picture;
mod quads;
mod rays;
mod report;
mod secondary;
mod shadow;
mod spheres;
#[cfg(test)]
mod tests;
mod watertight;

pub use self::case::{Case, CaseRun, PassCriterion};
pub use self::counts::{CaseCounts, WrongKind};
pub use self::report::{
    AccuracyReport, BackendCounts, CaseResult, ColumnReport, FailurePicture, VERSION,
};

use super::backend::{BuiltBackend, TestedBackend};
use crate::accel::Accelerator;
use crate::accel::brute::Brute;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::monitor::Monitor;

/// Backends, seed and number of rays of a run.
#[derive(Debug, Clone)]
pub struct AccuracySettings {
    /// The backends under test, in the order of the table's columns.
    pub tested_backends: Vec<TestedBackend>,
    /// Seed of all random rays.
    pub seed: u64,
    /// Number of rays, in multiples of the quick run.
    pub times: u64,
    /// Whether to draw pictures of failures.
    pub pictures: bool,
}

/// All tested backends and the oracle, built over one geometry.
struct Built<'g> {
    /// The geometry over which backends and oracle are built.
    geometry: &'g Geometry,
    /// The tested backends, in the order of the settings.
    tested: &'g [TestedBackend],
    /// The accelerator of each tested backend.
    accelerators: Vec<Box<dyn Accelerator + 'g>>,
    /// The oracle, which computes the exact answers.
    oracle: Brute<'g>,
}

impl Built<'_> {
    /// Iterates over the tested backends with their accelerators.
    fn backends(&self) -> impl Iterator<Item = BuiltBackend<'_>> {
        let built = self.tested.iter().zip(&self.accelerators);
        built.map(|(tested, accelerator)| BuiltBackend { tested, accelerator: &**accelerator })
    }

    /// Calls `judge` for every tested backend and returns the counts of each. Slow backends
    /// ([`TestedBackend::is_slow`]) are left out, with counts of 0, unless `with_slow`.
    fn counts(
        &self,
        with_slow: bool,
        mut judge: impl FnMut(BuiltBackend, &mut CaseCounts),
    ) -> Vec<CaseCounts> {
        let count = |backend: BuiltBackend| {
            let mut counts = CaseCounts::default();
            if with_slow || !backend.tested.is_slow() {
                judge(backend, &mut counts);
            }
            counts
        };
        self.backends().map(count).collect()
    }
}

/// All cases, in the order of the table.
pub fn catalogue() -> Vec<Case> {
    let groups = [
        watertight::cases(),
        degenerate::cases(),
        rays::cases(),
        grazing::cases(),
        quads::cases(),
        contact::cases(),
        secondary::cases(),
        spheres::cases(),
        map_coordinates::cases(),
        conservative::cases(),
    ];
    groups.into_iter().flatten().collect()
}

/// Runs all `cases` on the threads of the current rayon pool.
///
/// Calls `begun` with index and case when a case begins, and `done` with its row when it ends. No
/// count depends on the number of threads, except [`WrongKind::Slow`], which is timed.
///
/// # Errors
/// The errors of the builds and of `done`; `Interrupted` after a signal.
pub fn run(
    cases: &[Case],
    settings: &AccuracySettings,
    monitor: &Monitor,
    begun: &(dyn Fn(usize, &Case) + Sync),
    done: &mut dyn FnMut(&CaseResult) -> Result<()>,
) -> Result<AccuracyReport> {
    let mut report = AccuracyReport::new(settings, monitor)?;
    for (index, case) in cases.iter().enumerate() {
        begun(index, case);
        let row = case.run(settings, monitor)?;
        done(&row)?;
        report.rows.push(row);
    }
    Ok(report)
}
