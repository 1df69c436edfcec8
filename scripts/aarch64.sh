#!/bin/bash
# Builds the program and its core tests for 64-bit ARM Linux, and runs them in an emulator, QEMU:
#
#   aarch64.sh tests      PLY files of many writers; the answers of every instruction set
#   aarch64.sh kernels    the same and the unit tests of the tree, which compare the kernels of every
#                         instruction set with f64 (they compile the library twice, so .ci/run leaves them out)
#   aarch64.sh pictures   after one of these: pictures of all shipped scenes and of the reference scenes.
#                         Every instruction set must give the same bytes, and those of this machine, up to
#                         last bits of the C library
#
# The compiler optimises little, because that takes longer than the tests save.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
qemu=$(command -v qemu-aarch64-static || command -v qemu-aarch64) ||
    { echo "aarch64: found no QEMU, which runs programs for ARM: apt install qemu-user-static" >&2; exit 2; }
# shellcheck source=scripts/zig.sh
. scripts/zig.sh
triple=aarch64-unknown-linux-musl
emulated=$(realpath -m "${CARGO_TARGET_DIR:-target}")/emulated

# Prints the output of a test run. Fails if a filter matched no test.
some_ran() {
    awk '{ print } /^running / { any = 1; if ($2 == 0) none = 1 } END { exit none || !any }' ||
        { echo "aarch64: a filter matched no test" >&2; exit 1; }
}

case ${1:-} in
tests | kernels)
    rustup target add "$triple"
    tests=(--test alone)
    [ "$1" = tests ] || tests+=(--lib)
    CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_RUNNER=$qemu cargo-zigbuild test --locked --release --no-default-features \
        --target "$triple" --target-dir "$emulated" --config profile.release.opt-level=1 \
        --config profile.release.codegen-units=64 --config 'profile.release.lto="off"' \
        "${tests[@]}" -- ply_corpus:: simd:: bvh:: | some_ran
    ;;
pictures)
    export LIGHTPATH_OTHER="$qemu $emulated/$triple/release/lightpath" LIGHTPATH_TIERS="portable neon"
    cargo test --locked --release --test program -- --ignored the_same_on_another_machine | some_ran
    ;;
*)
    echo "usage: $0 tests | kernels | pictures" >&2
    exit 2
    ;;
esac
