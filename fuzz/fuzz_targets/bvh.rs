//! Converts bytes to a scene and rays. Checks `bvh` on every instruction set against the reference
//! of its tests.
#![no_main]

#[path = "../../tests/library/bvh/case.rs"]
mod case;
#[path = "../../tests/library/bvh/reference.rs"]
mod reference;
#[allow(dead_code)]
#[path = "../../tests/library/bvh/tiers.rs"]
mod tiers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    case::run(bytes);
});
