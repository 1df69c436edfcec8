#!/bin/bash
# Puts Zig on the PATH, which compiles and links C for other systems, and cargo-zigbuild, which hands it
# to cargo. Sourced, from the root of the repository. Both come from PyPI into target/portable-tools/.
tools=$(realpath -m "${CARGO_TARGET_DIR:-target}")/portable-tools
command -v rustup >/dev/null ||
    { echo "found no rustup, which installs Rust's libraries for other systems: https://rustup.rs" >&2; exit 2; }
scripts/setup.sh python
[ -x "$tools/bin/cargo-zigbuild" ] || {
    echo "installing Zig 0.17.1 and cargo-zigbuild 0.24.1 from PyPI into $tools"
    python3 -m venv --clear "$tools"
    "$tools/bin/python" -m pip install --quiet --disable-pip-version-check ziglang==0.17.1 cargo-zigbuild==0.24.1
}
PATH=$tools/bin:$PATH
