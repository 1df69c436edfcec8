#!/bin/bash
# Sets what makes programs the same on every machine: the time that files get, and compiler flags that keep the paths
# of this machine out. Sourced, from the root of the repository, with the target folder in `target`.
: "${SOURCE_DATE_EPOCH:=$(git log -1 --format=%ct 2>/dev/null || date +%s)}"
export SOURCE_DATE_EPOCH

# Paths may have spaces: the C flags are quoted, and Rust's are separated by the byte 31.
registry=${CARGO_HOME:-$HOME/.cargo}/registry/src
sysroot=$("${RUSTC:-rustc}" --print sysroot)
maps=("$PWD=." "$registry=registry" "$target=target")
export CC_SHELL_ESCAPED_FLAGS=1
CFLAGS=$(printf "'-ffile-prefix-map=%s' " "${maps[@]}")
CARGO_ENCODED_RUSTFLAGS=$(printf -- '--remap-path-prefix=%s\x1f' "${maps[@]}")--remap-path-prefix=$sysroot=rust
export CFLAGS CARGO_ENCODED_RUSTFLAGS
