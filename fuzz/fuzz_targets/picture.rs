//! Makes a scene of bytes and renders it in several ways.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

mod folder;
#[allow(dead_code)]
#[path = "../../tests/library/fuzz/inputs.rs"]
mod inputs;
#[allow(dead_code)]
#[path = "../../tests/library/fuzz/picture.rs"]
mod picture;
#[path = "../../tests/library/fuzz/witness.rs"]
mod witness;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = folder::create("picture");
    picture::prepare(&folder);
    folder
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    picture::run(&FOLDER, bytes);
});
