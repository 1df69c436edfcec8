//! Whether a frame that is there may stay.

use std::{ffi::OsStr, path::PathBuf};

use crate::output::finished::{self, Finished};

use super::{fingerprint::difference, sums::Sums};

/// Which frames that are there may stay.
#[derive(Debug, Clone, Copy)]
pub enum Resume<'a> {
    /// None.
    Nothing,
    /// Those of the same fingerprint, and with the same bytes if these are known.
    Keep(Option<&'a Sums>),
}

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

/// Looks at the files of a frame, which are those of [`Files::names`](crate::picture::Files::names). With `sums`
/// all of their bytes are read.
pub fn look(files: &[PathBuf], fingerprint: &str, sums: Option<&Sums>) -> Verdict {
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
    let doubt = sums.and_then(|sums| files.iter().find_map(|path| sums.doubt(path)));
    doubt.map_or(Verdict::Keep, Verdict::Again)
}
