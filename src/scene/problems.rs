//! Collects every problem of a scene, so that a user can fix all of them at once.

use std::io;
use std::path::Path;

use crate::error::Problem;

use super::document::Document;
use super::node::JsonPlace;

/// Errors and warnings about one document.
#[derive(Debug)]
pub struct Problems<'a> {
    /// The document that the problems are about.
    pub document: &'a Document,
    errors: Vec<((u32, u32), Problem)>,
    warnings: Vec<((u32, u32), Problem)>,
}

impl<'a> Problems<'a> {
    /// Makes an empty collection.
    pub fn new(document: &'a Document) -> Self {
        Self { document, errors: Vec::new(), warnings: Vec::new() }
    }

    /// Adds an error about the value at `pointer`.
    pub fn error(&mut self, pointer: &str, message: impl Into<String>, help: Option<String>) {
        let place = &self.document.nearest(pointer).place;
        self.error_at(place, pointer, message, help);
    }

    /// Adds an error at a place that a pointer cannot express: a key.
    pub fn error_at(
        &mut self,
        place: &JsonPlace,
        pointer: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) {
        let at = self.document.describe(place, pointer);
        let problem = Problem { help, ..Problem::new(at, message) };
        self.errors.push((place.order(), problem));
    }

    /// Adds what the operating system said about a file to the last error.
    pub fn cause_of(&mut self, file: &Path, cause: io::ErrorKind) {
        if let Some((_, problem)) = self.errors.last_mut() {
            *problem = problem.clone().cause_of(file, cause);
        }
    }

    /// Adds a warning about the value at `pointer`.
    pub fn warn(&mut self, pointer: &str, message: impl Into<String>, help: Option<String>) {
        let place = &self.document.nearest(pointer).place;
        let at = self.document.describe(place, pointer);
        let problem = Problem { help, ..Problem::new(at, message) };
        self.warnings.push((place.order(), problem));
    }

    /// Returns true if there is an error about the value at `pointer` itself.
    pub fn has_error(&self, pointer: &str) -> bool {
        let place = self.document.describe(&self.document.nearest(pointer).place, pointer);
        self.errors.iter().any(|(_, problem)| problem.place == place)
    }

    /// Returns true if there is no error so far. Warnings do not count.
    pub fn is_empty(&self) -> bool {
        self.errors.is_empty()
    }

    /// Returns the errors and the warnings, each in text order.
    pub fn finish(self) -> (Vec<Problem>, Vec<Problem>) {
        (sorted(self.errors), sorted(self.warnings))
    }
}

fn sorted(mut problems: Vec<((u32, u32), Problem)>) -> Vec<Problem> {
    problems.sort_by_key(|(order, _)| *order);
    problems.into_iter().map(|(_, problem)| problem).collect()
}
