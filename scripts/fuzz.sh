#!/bin/bash
# Builds the fuzz targets for short runs: `fuzz.sh`, then fuzz/target/x86_64-unknown-linux-gnu/release/TARGET FOLDER.
#
# Only what decodes and what mutates is optimised. With the instrumentation, the kernels that are compiled for each
# instruction set otherwise take ten times as long as a short run. For long runs, `cargo fuzz run TARGET` optimises all.
# `make test` runs the same targets on the inputs that are kept, tests/data/fuzz/, without instrumentation.
# The flags are those of cargo-fuzz: coverage, the address sanitizer, debug assertions.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
coverage='-Cpasses=sancov-module'
for option in level=4 inline-8bit-counters pc-table trace-compares; do
    coverage="$coverage -Cllvm-args=-sanitizer-coverage-$option"
done
optimised=()
for crate in exr fdeflate flate2 image libfuzzer-sys miniz_oxide png serde_json simd-adler32 zune-jpeg; do
    optimised+=(--config "profile.release.package.$crate.opt-level=1")
done
# The sanitizer is a feature of nightly compilers: RUSTC_BOOTSTRAP enables it in a stable one.
RUSTC_BOOTSTRAP=1 RUSTFLAGS="--cfg fuzzing -Zsanitizer=address -Cdebug-assertions $coverage" \
    cargo build --locked --release --manifest-path fuzz/Cargo.toml --target-dir fuzz/target \
    --target "$(uname -m)-unknown-linux-gnu" --config profile.release.opt-level=0 \
    --config profile.release.package.lightpath.codegen-units=64 "${optimised[@]}"
