//! The hard cases, on every backend, against answers that are known: what `lightpath accuracy` runs.
//!
//! A [`Case`] is a row of the table: what is traced, what must come out, and by what mark it passes.
//! Its file builds the geometry and aims the rays (`watertight`, `degenerate`, `rays`, `grazing`,
//! `quads`, `contact`, `secondary`, `spheres`, `map_coordinates`, `conservative`); [`Run`] traces them on every
//! [`Column`] and `judge` counts what is wrong.

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

/// The catalogue, in the order of the table.
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

/// Runs all `cases` on the threads of the current rayon pool. `begun` is told the number and the
/// case that begins, `done` its row. The same counts for any number of threads.
///
/// # Errors
/// Where a backend cannot be built; `Interrupted` after a signal.
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
