//! What several fuzz targets share. Each target uses a part of it.
#![allow(dead_code)]

use std::fs;
use std::path::{Component, Path, PathBuf};

use lightpath::Error;

/// Creates the folder of this process among the system's temporary files: `TMPDIR` names another
/// place.
pub fn folder(target: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("lightpath-{target}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
}

/// Writes a file.
pub fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).expect("space for a temporary file");
}

/// Checks that an error says something.
pub fn check(error: &Error) {
    assert!(!error.problems.is_empty());
    assert!(!error.to_string().is_empty());
}

/// Whether a path stays below the folder to which it is relative.
pub fn is_inside(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_)))
}
