//! Collects every problem of a scene, so that a user mends a file once.

use crate::error::Problem;

use super::document::Document;
use super::node::Place;

/// Problems and warnings about one document.
#[derive(Debug)]
pub struct Problems<'a> {
    /// What is complained about.
    pub document: &'a Document,
    errors: Vec<((u32, u32), Problem)>,
    warnings: Vec<((u32, u32), Problem)>,
}

impl<'a> Problems<'a> {
    /// None yet.
    pub fn new(document: &'a Document) -> Self {
        Self { document, errors: Vec::new(), warnings: Vec::new() }
    }

    /// An error at the value at `pointer`.
    pub fn error(&mut self, pointer: &str, message: impl Into<String>, help: Option<String>) {
        let place = &self.document.nearest(pointer).place;
        self.error_at(place, pointer, message, help);
    }

    /// An error at a place that no pointer alone finds: a key.
    pub fn error_at(
        &mut self,
        place: &Place,
        pointer: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) {
        let problem = Problem {
            place: self.document.describe(place, pointer),
            message: message.into(),
            help,
        };
        self.errors.push((place.order(), problem));
    }

    /// A warning at the value at `pointer`.
    pub fn warn(&mut self, pointer: &str, message: impl Into<String>, help: Option<String>) {
        let place = &self.document.nearest(pointer).place;
        let problem = Problem {
            place: self.document.describe(place, pointer),
            message: message.into(),
            help,
        };
        self.warnings.push((place.order(), problem));
    }

    /// True if nothing is wrong so far.
    pub fn is_empty(&self) -> bool {
        self.errors.is_empty()
    }

    /// Errors and warnings, each in the order of the text.
    pub fn finish(self) -> (Vec<Problem>, Vec<Problem>) {
        (sorted(self.errors), sorted(self.warnings))
    }
}

fn sorted(mut problems: Vec<((u32, u32), Problem)>) -> Vec<Problem> {
    problems.sort_by_key(|(order, _)| *order);
    problems.into_iter().map(|(_, problem)| problem).collect()
}
