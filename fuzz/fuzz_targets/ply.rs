//! Reads bytes as PLY.
#![no_main]

#[path = "../../tests/library/fuzz/ply.rs"]
mod ply;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    ply::run(bytes);
});
