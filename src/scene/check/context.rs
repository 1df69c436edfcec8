//! The state that all checks share.

use std::collections::BTreeSet;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::scene::description::Name;
use crate::scene::document::Document;
use crate::scene::node::{JsonNode, NodeKind};
use crate::scene::problems::Problems;

/// Maximum length of a name in characters. Layer names in EXR headers hold 255 bytes, including
/// prefixes and suffixes; they have one byte per character.
const MAX_NAME_CHARS: usize = 200;

/// The document, the problems found in it, and the folder of its files.
pub struct Check<'d, 'p> {
    pub document: &'d Document,
    pub problems: &'p mut Problems<'d>,
    /// Pointers with structural errors.
    pub broken: BTreeSet<String>,
    /// The folder that paths are relative to.
    pub folder: &'p Path,
    /// Whether the files are those of a scene that was checked before. They are not looked for: a
    /// batch renders the frames of a mesh that has left the disk.
    pub are_files_known: bool,
}

impl Check<'_, '_> {
    /// Returns the value at `pointer`. `None` if it is absent, or if it or a value below it has
    /// structural errors.
    pub fn part<T: DeserializeOwned>(&mut self, pointer: &str) -> Option<T> {
        self.part_at(pointer, self.document.get(pointer)?)
    }

    /// [`Check::part`] of the `node` at `pointer`, which is not searched for.
    pub fn part_at<T: DeserializeOwned>(&mut self, pointer: &str, node: &JsonNode) -> Option<T> {
        let below = format!("{pointer}/");
        let next = self.broken.range(below.clone()..).next();
        if self.broken.contains(pointer) || next.is_some_and(|p| p.starts_with(&below)) {
            return None;
        }
        match serde_json::from_value(node.to_value()) {
            Ok(part) => Some(part),
            Err(error) => {
                // Not expected: the schema is generated from the types.
                self.problems.error(pointer, error.to_string(), None);
                None
            }
        }
    }

    /// Returns the number of items of the array at `pointer`.
    pub fn count(&self, pointer: &str) -> usize {
        match self.document.get(pointer).map(|node| &node.kind) {
            Some(NodeKind::List(items)) => items.len(),
            _ => 0,
        }
    }

    /// Checks that a name can be written to an EXR header. Returns the name even if it cannot.
    pub fn name(&mut self, pointer: &str, name: &Option<Name>) -> Option<String> {
        let Name(name) = name.as_ref()?;
        // An empty name is already reported.
        if !name.is_empty() && name.trim().is_empty() {
            let message = format!("found {name:?}, expected a name that is not blank");
            self.problems.error(pointer, message, None);
        } else if name.chars().any(char::is_control) {
            let message = format!("found {name:?}, expected a name without control characters");
            self.problems.error(pointer, message, None);
        } else if name.chars().count() > MAX_NAME_CHARS {
            let count = name.chars().count();
            let message =
                format!("found a name of {count} characters, expected at most {MAX_NAME_CHARS}");
            self.problems.error(pointer, message, None);
        }
        Some(name.clone())
    }
}
