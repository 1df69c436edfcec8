//! Inputs that long runs of the fuzz targets found, and the files that these runs began with, are
//! still handled. `fuzz/` searches for further ones.

use std::cell::Cell;
use std::fs;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;

use super::{image, job, picture, ply, poses, scene};
use crate::bvh::case;

#[test]
fn rays_and_trees() {
    let hits = Cell::new(0);
    for_each_input("bvh", &[], |_| {}, |_, bytes| hits.set(hits.get() + case::run(bytes)));
    assert!(hits.get() > 1_000, "{}", hits.get());
}

#[test]
fn images() {
    let textures = Cell::new(0);
    for_each_input("image", &["tests/data/fuzz/seeds/image"], image::prepare, |folder, bytes| {
        textures.set(textures.get() + u32::from(image::run(folder, bytes)));
    });
    assert!(textures.get() > 100, "{}", textures.get());
}

#[test]
fn jobs() {
    let seeds = "tests/data/fuzz/seeds/job";
    for_each_input("job", &[seeds], job::prepare, job::run);
    let read = |name| fs::read(root().join(seeds).join(name)).expect("a seed");
    assert_eq!(job::baseline(&read("baseline.json")), Some(6));
    assert_eq!(job::findings(&read("findings.json")), Some(1));
}

#[test]
fn pictures() {
    let (shown, lit) = (Cell::new(0), Cell::new(0));
    for_each_input("picture", &[], picture::prepare, |folder, bytes| {
        if let Some(picture) = picture::run(folder, bytes) {
            shown.set(shown.get() + 1);
            lit.set(lit.get() + u32::from(picture.light && picture.shadow_rays > 0));
        }
    });
    assert!(shown.get() > 10 && lit.get() > 5, "{} {}", shown.get(), lit.get());
}

#[test]
fn ply_files() {
    let meshes = Cell::new(0);
    let run = |bytes: &[u8]| meshes.set(meshes.get() + u32::from(ply::run(bytes)));
    for_each_input("ply", &[], |_| {}, |_, bytes| run(bytes));
    assert!(meshes.get() > 40, "{}", meshes.get());
    // The last byte of an input selects options, and is no part of the file. 3 asks for repairs.
    let mut failed = Vec::new();
    for (folder, is_valid) in [("tests/ply/valid", true), ("tests/ply/invalid", false)] {
        let meshes = Cell::new(0);
        for_each_file(&root().join(folder), &mut failed, |bytes| {
            for options in [0, 2, 3] {
                let is_mesh = ply::run(&[bytes, &[options]].concat());
                assert!(!is_mesh || is_valid || options == 3);
                meshes.set(meshes.get() + usize::from(is_mesh));
            }
        });
        // The other files are the expected meshes.
        let is_ply = |path: &&PathBuf| path.extension().is_none_or(|end| end != "json");
        let count = files(&root().join(folder)).iter().filter(is_ply).count();
        assert!(!is_valid || count > 40 && meshes.get() == 3 * count, "{}", meshes.get());
    }
    assert!(failed.is_empty(), "ply failed on {failed:?}");
}

#[test]
fn lists_of_cameras() {
    let lists = Cell::new(0);
    for_each_input(
        "poses",
        &["tests/data/fuzz/seeds/poses"],
        |_| {},
        |folder, bytes| {
            lists.set(lists.get() + u32::from(poses::run(folder, bytes)));
        },
    );
    assert!(lists.get() > 10, "{}", lists.get());
}

#[test]
fn scenes() {
    let (scenes, shipped) = (Cell::new(0), Cell::new(0));
    for_each_input(
        "scene",
        &[],
        |_| {},
        |_, bytes| {
            scenes.set(scenes.get() + u32::from(scene::run(Path::new("nowhere"), bytes)));
        },
    );
    let mut failed = Vec::new();
    for folder in ["scenes", "tests/data/reference"].map(|folder| root().join(folder)) {
        for_each_file(&folder, &mut failed, |bytes| {
            shipped.set(shipped.get() + u32::from(scene::run(&folder, bytes)));
        });
    }
    assert!(failed.is_empty(), "scene failed on {failed:?}");
    assert!(scenes.get() > 5 && shipped.get() > 35, "{} {}", scenes.get(), shipped.get());
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
    for folder in seeds.iter().map(|seeds| root().join(seeds)).chain([kept.path().join(target)]) {
        for_each_file(&folder, &mut failed, |bytes| run(scratch.path(), bytes));
    }
    assert!(failed.is_empty(), "{target} failed on {failed:?}");
}

/// Runs the files of a folder, and adds those on which `run` panics to `failed`.
fn for_each_file(folder: &Path, failed: &mut Vec<PathBuf>, run: impl Fn(&[u8])) {
    let files = files(folder);
    assert!(!files.is_empty(), "{} has no input", folder.display());
    for file in files {
        let bytes = fs::read(&file).expect("a readable input");
        // `run` keeps nothing but files that the next input replaces.
        if catch_unwind(AssertUnwindSafe(|| run(&bytes))).is_err() {
            failed.push(file);
        }
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
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
