#!/bin/sh
# crate.sh         installs the program from the packaged crate, as `cargo install` does, with no file of
#                  this folder. Its renders must have the bytes of the program that `make build` compiled.
#                  The crate itself is not optimised: it compiles faster, and the bytes do not depend on it.
# crate.sh check   takes a quarter of the time: the packaged crate passes the compiler's checks with no
#                  file of this folder, and its sources are those of this folder.
set -eu
cd "$(dirname "$0")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
built=$(realpath -m "${BINARY:-$target/release/lightpath}")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

say() { printf 'crate: %s\n' "$*"; }

cargo package --quiet --locked --no-verify --allow-dirty --target-dir "$scratch/target"
crate=$scratch/lightpath-$version
tar -xf "$scratch/target/package/lightpath-$version.crate" -C "$scratch"
say "$(find "$crate" -type f | wc -l) files, $(du -sk "$crate" | cut -f 1) KiB"
# In the target folder of `make build`, which has the dependencies. Without optimisation, no file of
# `make build` is replaced: cargo would take both crates for the same one.
part=${1:-}
set -- --locked --target-dir "$target" \
    --config profile.release.package.lightpath.opt-level=0 \
    --config profile.release.package.lightpath.codegen-units=64
if [ "$part" = check ]; then
    (cd / && cargo check --quiet --release --manifest-path "$crate/Cargo.toml" "$@")
    diff -r src "$crate/src"
    for file in build.rs Cargo.lock; do cmp "$file" "$crate/$file"; done
    say "its sources are those of this folder, and pass the compiler's checks"
    exit
fi

# The program in the target folder is kept.
cp "$built" "$scratch/built"
(cd / && cargo install --quiet --path "$crate" --root "$scratch/installed" --no-track "$@")
cp --remove-destination "$scratch/built" "$built"
# The crate's path is another one in each run, so its files are of no further use.
find "$target/release/deps" -newer "$scratch/built" -name '*lightpath-*' -delete

installed=$scratch/installed/bin/lightpath
"$installed" --version --verbose

cd "$crate"
mkdir "$scratch/installed-out" "$scratch/built-out"
for input in scenes/still-life.json assets/teapot.ply; do
    "$installed" render "$input" --size 64x48 --spp 4 --quiet -o "$scratch/installed-out" >"$scratch/files"
    "$built" render "$input" --size 64x48 --spp 4 --quiet -o "$scratch/built-out" >"$scratch/files"
done
diff -r "$scratch/installed-out" "$scratch/built-out"
say "the same bytes: $(ls -x "$scratch/built-out")"
