//! Reads bytes as a list of cameras.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

mod folder;
#[allow(dead_code)]
#[path = "../../tests/library/fuzz/inputs.rs"]
mod inputs;
#[path = "../../tests/library/fuzz/poses.rs"]
mod poses;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| folder::create("poses"));

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    poses::run(&FOLDER, bytes);
});
