#!/bin/bash
# Builds the program and its core tests for 64-bit ARM Linux, and runs them in an emulator, QEMU:
#
#   aarch64.sh tests      PLY files of many writers
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

# Prints the output of a test run. Fails if one of the filters matched no test.
some_ran() { # FILTER...
    awk -v filters="$*" '
        { print }
        /^test / { names = names $2 " " }
        END {
            split(filters, of)
            for (i in of) if (!index(names, of[i])) { print "aarch64: no test matches " of[i]; bad = 1 }
            exit bad
        }'
}

case ${1:-} in
tests | kernels)
    rustup target add "$triple"
    tests=(--test alone) filters=(ply_corpus::)
    [ "$1" = tests ] || { tests+=(--lib) filters+=(simd:: bvh::); }
    CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_RUNNER=$qemu cargo-zigbuild test --locked --release --no-default-features \
        --target "$triple" --target-dir "$emulated" --config profile.release.opt-level=1 \
        --config profile.release.codegen-units=64 --config 'profile.release.lto="off"' \
        "${tests[@]}" -- "${filters[@]}" | some_ran "${filters[@]}"
    ;;
pictures)
    export LIGHTPATH_OTHER="$qemu $emulated/$triple/release/lightpath" LIGHTPATH_TIERS="portable neon"
    filter=the_same_on_another_machine
    cargo test --locked --release --test program -- --ignored "$filter" | some_ran "$filter"
    ;;
*)
    echo "usage: $0 tests | kernels | pictures" >&2
    exit 2
    ;;
esac
