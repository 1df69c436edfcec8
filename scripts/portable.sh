#!/bin/bash
# Builds programs for other machines into target/dist/, in addition to the packages of `make dist`:
#
#   lightpath-VERSION-x86_64-linux-glibc2.28.tar.xz   with the Embree of vendor/embree, if it is there
#   lightpath-VERSION-x86_64-linux-static.tar.xz      needs nothing; `bvh` is inside, Embree is not
#   lightpath-VERSION-aarch64-linux-static.tar.xz     the same for 64-bit ARM
#   lightpath-VERSION.cdx.json                        what they and those of `make dist` contain (CycloneDX)
#   SHA256SUMS                                        of everything of this version in the folder
#
# Zig compiles the C parts and links: it has the C libraries of all these systems. It comes from PyPI into
# target/portable-tools/, Rust's libraries for the targets from rustup, cargo-cyclonedx from crates.io.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
if [ -n "${EMBREE_DIR:-}" ]; then
    echo "portable: EMBREE_DIR is $EMBREE_DIR, a folder of this machine: unset it" >&2
    exit 2
fi
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
dist=$target/dist

# shellcheck source=scripts/zig.sh
. scripts/zig.sh

# shellcheck source=scripts/remap.sh
. scripts/remap.sh

rm -f "$dist/SHA256SUMS"

# build TARGET NAME EMBREE FLAG...
build() {
    local triple=$1 name=lightpath-$version-$2 embree=$3
    rustup target add "${triple%.2.28}"
    cargo zigbuild --locked --release --bin lightpath --target "$triple" --target-dir "$target" "${@:4}"
    local program=$target/${triple%.2.28}/release/lightpath
    local newest
    newest=$(grep -ao 'GLIBC_2\.[0-9]*' "$program" | sort -uV | tail -n 1 || true)
    [ "$(printf '%s\n' "$newest" GLIBC_2.28 | sort -V | tail -n 1)" = GLIBC_2.28 ] ||
        { echo "portable: $program needs $newest" >&2; exit 1; }
    LC_ALL=C readelf -h "$program" | grep -q 'Type: *DYN' ||
        { echo "portable: $program has fixed addresses" >&2; exit 1; }
    BINARY=$program SPEAKER=$target/release/lightpath \
        scripts/folder.sh "$dist" "$name" "$embree"
}
build x86_64-unknown-linux-gnu.2.28 x86_64-linux-glibc2.28 vendor/embree
# Zig's linker otherwise gives static programs fixed addresses, which whoever crafts a file would know.
export CARGO_ENCODED_RUSTFLAGS+=$'\x1f-Clink-arg=-pie'
build x86_64-unknown-linux-musl x86_64-linux-static none --no-default-features
build aarch64-unknown-linux-musl aarch64-linux-static none --no-default-features

unset CARGO_ENCODED_RUSTFLAGS CFLAGS
[ -x "$tools/bin/cargo-cyclonedx" ] || {
    echo "portable: installing cargo-cyclonedx from crates.io into $tools"
    cargo install --quiet --locked --root "$tools" cargo-cyclonedx@0.5.7
}
trap 'rm -f sbom.json' EXIT
cargo cyclonedx --quiet --format json --override-filename sbom --target all
# It writes one for every package.
rm -f python/sbom.json tests/reference/sbom.json
scripts/sbom.py sbom.json "$dist/lightpath-$version.cdx.json"

scripts/sums.sh "$dist" "$version"
