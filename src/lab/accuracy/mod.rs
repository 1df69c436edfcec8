//! Hard cases with known answers, traced on every backend, for `lightpath accuracy`.
//!
//! A [`Case`] is a row of the table: its rays, their right answers and its pass criterion, a
//! [`PassCriterion`]. A column of the table is a backend under test, a
//! [`TestedBackend`](super::backend::TestedBackend). The files `watertight`, `degenerate`, `rays`,
//! `grazing`, `quads`, `contact`, `secondary`, `spheres`, `map_coordinates` and `conservative`
//! build the geometry and aim the rays. [`CaseRun`] traces the rays with every tested backend.
//! `judge` counts wrong answers, unless a case counts them itself.

mod backends;
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
mod settings;
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
pub use self::settings::AccuracySettings;

use crate::error::Result;
use crate::monitor::Monitor;

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
