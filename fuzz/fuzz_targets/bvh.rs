//! Turns bytes into a scene and rays. Checks `bvh` in every instruction set with the reference of
//! its own tests.
#![no_main]

#[path = "../../tests/library/bvh/case.rs"]
mod case;
#[path = "../../tests/library/bvh/reference.rs"]
mod reference;
#[allow(dead_code)]
#[path = "../../tests/library/bvh/tiers.rs"]
mod tiers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| case::run(bytes));
