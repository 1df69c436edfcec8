//! Reads bytes as an image file.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

mod folder;
#[path = "../../tests/library/fuzz/image.rs"]
mod image;
#[allow(dead_code)]
#[path = "../../tests/library/fuzz/inputs.rs"]
mod inputs;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = folder::create("image");
    image::prepare(&folder);
    folder
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    image::run(&FOLDER, bytes);
});
