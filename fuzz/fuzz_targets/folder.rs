//! Temporary files of a fuzz target.

use std::fs;
use std::path::{Path, PathBuf};

/// Creates the folder of this process. Files in memory make the runs fast.
pub fn new(target: &str) -> PathBuf {
    let memory = Path::new("/dev/shm");
    let temp = std::env::temp_dir();
    let folder = if memory.is_dir() { memory } else { &temp };
    let folder = folder.join(format!("lightpath-{target}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
}

/// Writes a file.
pub fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).expect("space for a temporary file");
}
