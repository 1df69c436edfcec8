//! Reads bytes as a job file.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

mod folder;
#[allow(dead_code)]
#[path = "../../tests/library/fuzz/inputs.rs"]
mod inputs;
#[path = "../../tests/library/fuzz/job.rs"]
mod job;

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = folder::create("job");
    job::prepare(&folder);
    folder
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| job::run(&FOLDER, bytes));
