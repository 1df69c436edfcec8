//! Collects every problem of a scene, so that a user can fix all of them at once.

use std::io;
use std::path::Path;

use crate::error::{Error, ErrorKind, Problem};

use super::document::Document;
use super::node::JsonPlace;

/// Errors and warnings about one document.
#[derive(Debug)]
pub struct Problems<'a> {
    /// The document that the problems are about.
    pub document: &'a Document,
    errors: Vec<((u32, u32), Problem)>,
    warnings: Vec<((u32, u32), Problem)>,
    /// Number of errors that a retry may cure.
    passing: usize,
}

impl<'a> Problems<'a> {
    /// Makes an empty collection.
    pub fn new(document: &'a Document) -> Self {
        Self { document, errors: Vec::new(), warnings: Vec::new(), passing: 0 }
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

    /// Adds what the operating system said about the file `path` to the last error.
    pub fn failed_file(&mut self, path: &Path, error: &io::Error) {
        if let Some((_, problem)) = self.errors.last_mut() {
            *problem = problem.clone().failed_file(path, error);
        }
        let kind = Error::io(path, "read", error).kind;
        self.passing += usize::from(kind == ErrorKind::Retry);
    }

    /// Returns the class of all errors together.
    pub fn kind(&self) -> ErrorKind {
        match self.passing > 0 && self.passing == self.errors.len() {
            true => ErrorKind::Retry,
            false => ErrorKind::Invalid,
        }
    }

    /// Adds a warning about the value at `pointer`.
    pub fn warn(&mut self, pointer: &str, message: impl Into<String>, help: Option<String>) {
        let place = &self.document.nearest(pointer).place;
        self.warn_at(place, pointer, message, help);
    }

    /// [`Problems::warn`] at the `place` of that value, which is not searched for.
    pub fn warn_at(
        &mut self,
        place: &JsonPlace,
        pointer: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_retry_helps_only_if_it_may_cure_every_error() {
        let document = Document::parse("s.json", b"{}").unwrap();
        let mut problems = Problems::new(&document);
        assert_eq!(problems.kind(), ErrorKind::Invalid);
        problems.error("", "cannot look at a.ply", None);
        // ESTALE.
        problems.failed_file("a.ply".as_ref(), &io::Error::from_raw_os_error(116));
        assert_eq!(problems.kind(), ErrorKind::Retry);
        problems.error("", "cannot look at b.ply", None);
        problems.failed_file("b.ply".as_ref(), &io::ErrorKind::NotFound.into());
        assert_eq!(problems.kind(), ErrorKind::Invalid);
    }
}
