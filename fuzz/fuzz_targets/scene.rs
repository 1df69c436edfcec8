//! Reads bytes as a scene file.
#![no_main]

use std::path::Path;

#[allow(dead_code)]
#[path = "../../tests/library/fuzz/inputs.rs"]
mod inputs;
#[path = "../../tests/library/fuzz/scene.rs"]
mod scene;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    scene::run(Path::new("nowhere"), bytes);
});
