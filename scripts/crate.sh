#!/bin/sh
# crate.sh         installs the program from the packaged crate, as `cargo install` does, with no file of
#                  this folder. Its renders must have the bytes of the program that `make build` compiled.
#                  The crate itself is not optimised: it compiles faster, and the bytes do not depend on it.
# crate.sh check   at once: the packaged crate has every file of which the compiler made that program, with
#                  the same bytes.
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
size=$(stat -c %s "$scratch/target/package/lightpath-$version.crate")
say "$(find "$crate" -type f | wc -l) files, $size bytes packed"
[ "$size" -lt 10000000 ] || { say "crates.io takes no more than 10 MB" >&2; exit 1; }
if [ "${1:-}" = check ]; then
    # Cargo lists them behind the program's name, and with them what build.rs looks at: the repository's
    # commit and the library of Embree, which a crate has not. It rewrites Cargo.toml in a crate.
    # Its spaces within names follow a backslash.
    folder=$(printf %s "$PWD" | tr ' ' '\001')
    files=$(sed 's|\\ |\x01|g; s|^[^:]*:||; s| /|\n/|g' "$built.d" | sed -n "s|^$folder/||p" | sed '/^\.git\//d; /^vendor\//d')
    count=$(echo "$files" | wc -w)
    [ "$count" -gt 500 ] || { say "found too few files in $built.d"; exit 1; }
    mv "$crate/Cargo.toml.orig" "$crate/Cargo.toml"
    # The crate has no tests and no Python package, and so not what only they need.
    packages() { sed -n '/^name = /N; s/^name = "\(.*\)"\nversion = "\(.*\)"/\1 \2/p' "$1" | sort; }
    packages Cargo.lock >"$scratch/ours"
    packages "$crate/Cargo.lock" >"$scratch/packaged"
    [ "$(comm -12 "$scratch/ours" "$scratch/packaged" | wc -l)" -gt 100 ] || { say "found no packages"; exit 1; }
    other=$(comm -13 "$scratch/ours" "$scratch/packaged")
    [ -z "$other" ] || { say "other versions than in Cargo.lock: $other"; exit 1; }
    for file in $(echo "$files" | sed '/^Cargo.lock$/d'); do
        [ -d "$file" ] || cmp "$file" "$crate/$file"
    done
    say "it has the $count files of which $built was made"
    exit
fi

# In the target folder of `make build`, which has the dependencies. The program there is kept.
cp "$built" "$scratch/built"
(cd / && cargo install --quiet --locked --path "$crate" --root "$scratch/installed" --target-dir "$target" \
    --no-track --config profile.release.package.lightpath.opt-level=0 \
    --config profile.release.package.lightpath.codegen-units=64)
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
