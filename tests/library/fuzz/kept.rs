//! Inputs that long runs of the fuzz targets found, and the files that these runs began with, are
//! still handled. `fuzz/` searches for further ones.

use std::fs;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;

use super::{image, job, ply, poses, scene};
use crate::bvh::case;

#[test]
fn rays_and_trees() {
    for_each_input("bvh", &[], |_| {}, |_, bytes| case::run(bytes));
}

#[test]
fn images() {
    for_each_input("image", &["tests/data/fuzz/seeds/image"], image::prepare, image::run);
}

#[test]
fn jobs() {
    for_each_input("job", &["tests/data/fuzz/seeds/job"], job::prepare, job::run);
}

#[test]
fn ply_files() {
    let seeds = ["tests/ply/valid", "tests/ply/invalid"];
    for_each_input("ply", &seeds, |_| {}, |_, bytes| ply::run(bytes));
}

#[test]
fn lists_of_cameras() {
    for_each_input("poses", &["tests/data/fuzz/seeds/poses"], |_| {}, poses::run);
}

#[test]
fn scenes() {
    let seeds = ["scenes", "tests/data/reference"];
    for_each_input("scene", &seeds, |_| {}, |_, bytes| scene::run(bytes));
}

/// Runs the kept inputs of a target, and the files of folders. `run` also takes a folder for files,
/// which `prepare` fills once.
fn for_each_input(
    target: &str,
    seeds: &[&str],
    prepare: impl Fn(&Path),
    run: impl Fn(&Path, &[u8]),
) {
    let kept = unpack(target);
    let scratch = TempDir::new().expect("a folder for temporary files");
    prepare(scratch.path());
    let mut failed = Vec::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in seeds.iter().map(|seeds| root.join(seeds)).chain([kept.path().join(target)]) {
        let files = files(&folder);
        assert!(!files.is_empty(), "{} has no input", folder.display());
        for file in files {
            let bytes = fs::read(&file).expect("a readable input");
            // `run` keeps nothing but files that the next input replaces.
            if catch_unwind(AssertUnwindSafe(|| run(scratch.path(), &bytes))).is_err() {
                failed.push(file);
            }
        }
    }
    assert!(failed.is_empty(), "{target} failed on {failed:?}");
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("a file").path());
    entries.filter(|path| path.is_file()).collect()
}

/// Unpacks the kept inputs of one target.
fn unpack(target: &str) -> TempDir {
    let folder = TempDir::new().expect("a folder for temporary files");
    let packed = include_bytes!("../../data/fuzz/corpus.tar.zst");
    let archive = zstd::decode_all(packed.as_slice()).expect("an intact archive");
    let mut tar = Command::new("tar")
        .args(["-x", target])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .spawn()
        .expect("the program `tar`");
    tar.stdin.take().expect("a pipe").write_all(&archive).expect("a running `tar`");
    assert!(tar.wait().expect("an exit code").success());
    folder
}
