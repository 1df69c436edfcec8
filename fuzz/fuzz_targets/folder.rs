//! A folder for the files that a fuzz target writes.

use std::fs;
use std::path::PathBuf;

/// Creates the folder of this process among the system's temporary files: `TMPDIR` names another
/// place.
pub fn create(target: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("lightpath-{target}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
}
