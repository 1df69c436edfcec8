//! Whether a frame that is there may stay.

use std::{ffi::OsStr, path::PathBuf};

use crate::output::finished::{self, Finished};

use super::fingerprint::difference;

/// What to do with a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// It is whole and of the same fingerprint.
    Keep,
    /// There is nothing yet.
    Render,
    /// There is something else: why it is rendered again.
    Again(String),
}

/// Looks at the files of a frame, which are those of [`Files::names`](crate::picture::Files::names).
pub fn look(files: &[PathBuf], fingerprint: &str) -> Verdict {
    let found = files.iter().map(|path| match path.extension().and_then(OsStr::to_str) {
        Some("exr") => (path, finished::exr(path)),
        Some("png") => (path, finished::png(path)),
        // A manifest gets its name before the EXR that says what they are both made of.
        _ if path.is_file() => (path, Finished::Whole(Some(fingerprint.to_string()))),
        _ => (path, Finished::Missing),
    });
    let found: Vec<(&PathBuf, Finished)> = found.collect();
    if found.iter().all(|(_, state)| *state == Finished::Missing) {
        return Verdict::Render;
    }
    for (path, state) in found {
        let name = path.display();
        return Verdict::Again(match state {
            Finished::Whole(Some(there)) if there == fingerprint => continue,
            Finished::Whole(Some(there)) => {
                format!("{name}: {}", difference(&there, fingerprint))
            }
            Finished::Whole(None) => format!("{name} does not say what it was made of"),
            Finished::Broken => format!("{name} is not whole"),
            Finished::Missing => format!("{name} is missing"),
        });
    }
    Verdict::Keep
}
