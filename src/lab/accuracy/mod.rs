//! Hard cases with known answers, traced on every backend, for `lightpath accuracy`.
//!
//! A [`Case`] is a row of the table: its rays, their right answers and its pass criterion, a
//! [`Mark`]. A backend is a [`Column`]. The files `watertight`, `degenerate`, `rays`, `grazing`,
//! `quads`, `contact`, `secondary`, `spheres`, `map_coordinates` and `conservative` build the
//! geometry and aim the rays. [`Run`] traces the rays on every column, and `judge` counts wrong
//! answers.

mod case;
mod column;
mod conservative;
mod contact;
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
mod tally;
#[cfg(test)]
mod tests;
mod watertight;

pub use self::case::{Case, Mark, Run};
pub use self::column::{Column, Settings};
pub use self::report::{ColumnReport, Entry, Picture, Report, Row, VERSION, available};
pub use self::tally::{Kind, Tally};

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
/// Calls `begun` with index and case when a case begins, and `done` with its row when it ends. The
/// counts do not depend on the number of threads.
///
/// # Errors
/// The errors of the builds and of `done`; `Interrupted` after a signal.
pub fn run(
    cases: &[Case],
    settings: &Settings,
    monitor: &Monitor,
    begun: &(dyn Fn(usize, &Case) + Sync),
    done: &mut dyn FnMut(&Row) -> Result<()>,
) -> Result<Report> {
    let mut report = Report::new(settings, monitor)?;
    for (index, case) in cases.iter().enumerate() {
        begun(index, case);
        let row = case.run(settings, monitor)?;
        done(&row)?;
        report.rows.push(row);
    }
    Ok(report)
}
