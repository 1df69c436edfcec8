//! Rules for the sources, the package and the tables of the documentation.

use std::{
    fs,
    path::{Path, PathBuf},
};

mod build_script;
#[cfg(feature = "embree")]
mod embree_layout;
mod house_rules;
mod layering;

/// Returns all Rust files below a folder of the repository, sorted. There must be some.
fn rust_files(folder: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    list(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut files);
    files.sort();
    assert!(!files.is_empty(), "no file found under {folder}/");
    files
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            list(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}
