//! Validates the points of a file that is read without faces.

use super::check::Tally;
use super::context::ReadContext;
use super::vertex::PlyVertices;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::mesh::arrays::Positions;

/// Checks that there are points and that all are finite. With `repair`, points that are not finite
/// are dropped and counted.
///
/// # Errors
/// If no finite point is left. Without `repair`, also if any point is not finite.
pub(super) fn check(
    vertices: &mut PlyVertices,
    tally: &mut Tally,
    context: &ReadContext,
    repair: bool,
) -> Result<()> {
    let finite: Vec<bool> = match &vertices.positions {
        Positions::F32(all) => all.iter().map(|p| p.iter().all(|c| c.is_finite())).collect(),
        Positions::F64(all) => all.iter().map(|p| p.iter().all(|c| c.is_finite())).collect(),
    };
    let bad = finite.iter().filter(|finite| !**finite).count();
    if bad == finite.len() {
        let count = finite.len();
        let message = match count {
            0 => "has no points".to_string(),
            1 => "its only point is not finite".to_string(),
            _ => format!("all {count} points are not finite"),
        };
        return Err(Error::invalid(context.name, message));
    }
    let Some(first) = finite.iter().position(|finite| !finite) else { return Ok(()) };
    if !repair {
        let [x, y, z] = vertices.positions.get(first).to_array();
        let message = format!("({x}, {y}, {z}) is not finite; such points in all: {bad}");
        let problem = Problem::new(format!("{}: vertex {first}", context.name), message);
        let help = format!("--repair drops the {bad}");
        return Err(Error::new(ErrorKind::Invalid, problem).help(help));
    }
    tally.unusable += bad as u64;
    vertices.retain(|i| finite[i]);
    Ok(())
}
