//! Where rows are, and what to say of those that are not there.

use super::header::{Element, Shape};
use super::job::Job;
use crate::error::Error;

/// Some rows of an element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    pub(super) start: usize,
    pub(super) end: usize,
    /// The number of the first row.
    pub(super) row: u64,
    pub(super) rows: u64,
    /// Lines of text before the block.
    pub(super) line: u64,
}

/// All rows have the same size.
#[derive(Debug, Clone)]
pub(super) struct Uniform {
    pub(super) start: usize,
    pub(super) stride: usize,
    /// Where each property starts in a row (a list: its first item).
    pub(super) offsets: Vec<usize>,
    /// The length of each list (1 for a single number).
    pub(super) lengths: Vec<u64>,
}

/// Rows of one element that follow each other.
#[derive(Debug, Default)]
pub(super) struct Span {
    /// The number of the first row.
    pub(super) first: u64,
    pub(super) rows: u64,
    pub(super) uniform: Option<Uniform>,
    pub(super) blocks: Vec<Block>,
}

/// "the file is cut short": `found` rows of `element` are there.
pub(super) fn too_short(element: &Element, found: u64, have: &str, job: &Job) -> Error {
    let declared = element.rows(element.count);
    Error::invalid(
        job.name,
        format!("the header declares {declared}, but only {found} are in the file: {have}"),
    )
    .help("the file is cut short or its header is wrong: write it again")
}

/// The values of a row, for messages.
pub(super) fn expected(element: &Element) -> String {
    let names = element.properties.iter().map(|p| match p.shape {
        Shape::Single(_) => p.name.clone(),
        Shape::List { .. } => format!("COUNT {}...", p.name),
    });
    names.collect::<Vec<_>>().join(" ")
}
