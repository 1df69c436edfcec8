//! Byte ranges of rows, and the errors for missing rows.

use super::context::ReadContext;
use super::header::{Element, PropertyType};
use crate::error::Error;

/// A range of rows of an element that one task reads. `start` and `end` are byte offsets in the
/// data.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowBlock {
    pub(super) start: usize,
    pub(super) end: usize,
    /// Index of the first row.
    pub(super) row: u64,
    pub(super) rows: u64,
    /// Number of lines of text before the block.
    pub(super) line: u64,
}

/// The layout of rows that all have the same size. `start` is the byte offset of the first row in
/// the data, `stride` the size of a row.
#[derive(Debug, Clone)]
pub(super) struct Uniform {
    pub(super) start: usize,
    pub(super) stride: usize,
    /// Offset of each property in a row; for a list, the offset of its first item.
    pub(super) offsets: Vec<usize>,
    /// Length of each list; 1 for a single number.
    pub(super) lengths: Vec<u64>,
}

/// Consecutive rows of one element. `uniform` is set if all are known to have the same size.
#[derive(Debug, Default)]
pub(super) struct Span {
    /// Index of the first row.
    pub(super) first: u64,
    pub(super) rows: u64,
    pub(super) uniform: Option<Uniform>,
    pub(super) blocks: Vec<RowBlock>,
}

/// The error for a file that holds only `found` of the declared rows of `element`. `have` describes
/// the data that is there.
pub(super) fn too_short(element: &Element, found: u64, have: &str, context: &ReadContext) -> Error {
    let declared = element.rows(element.count);
    let verb = if found == 1 { "is" } else { "are" };
    Error::invalid(
        context.name,
        format!("the header declares {declared}, but only {found} {verb} in the file: {have}"),
    )
    .help("the file is cut short or its header is wrong: write it again")
}

/// Returns the names of the values of a row, for messages.
pub(super) fn expected(element: &Element) -> String {
    let names = element.properties.iter().map(|p| match p.shape {
        PropertyType::Single(_) => p.name.clone(),
        PropertyType::List { .. } => format!("COUNT {}...", p.name),
    });
    names.collect::<Vec<_>>().join(" ")
}
