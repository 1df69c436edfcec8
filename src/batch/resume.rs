//! Whether a frame that is there may stay.

use std::path::Path;

use crate::output::{
    Outputs,
    finished::{self, Finished},
};

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

/// Looks at both files of a frame.
pub fn look(prefix: &Path, fingerprint: &str) -> Verdict {
    let [exr, png] = Outputs::names(prefix);
    let found = [(&exr, finished::exr(&exr)), (&png, finished::png(&png))];
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
