//! What several fuzz targets share.

use std::fs;
use std::path::{Component, Path};

use lightpath::Error;

/// Writes a file.
pub fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).expect("space for a temporary file");
}

/// Checks that an error says something.
pub fn check_error(error: &Error) {
    assert!(!error.problems.is_empty());
    assert!(!error.to_string().is_empty());
}

/// Whether a path stays below the folder to which it is relative.
pub fn is_inside(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_)))
}
