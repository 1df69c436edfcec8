#!/bin/bash
# Builds the image of the Containerfile without a daemon, with buildah, and renders in it as another
# user than root. The files must have the bytes that the program writes outside. Needs root, buildah
# and the programs of `make portable`. Another program to compare with: BINARY.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
outside=$(realpath -m "${BINARY:-$target/release/lightpath}")
static=x86_64-unknown-linux-musl/release/lightpath
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

say() { printf 'container: %s\n' "$*"; }
die() {
    say "$*" >&2
    exit 2
}
command -v buildah >/dev/null || die "found no buildah: apt-get install --no-install-recommends buildah"
for program in "$target/$static" "$outside"; do
    [ -x "$program" ] || die "found no $program: make build portable"
done

# Keeps images in the scratch folder. `chroot` needs no other rights than those of root.
image() { buildah --root "$scratch/store" --runroot "$scratch/run" --storage-driver vfs "$@"; }

# A context of only the files that the Containerfile names, with the modes that they have under umask 077.
context=$scratch/context
install -D -m 700 -t "$context/target/${static%/*}" "$target/$static"
install -m 600 -t "$context" LICENSE-MIT LICENSE-APACHE THIRD_PARTY.md THIRD_PARTY_LICENSES.txt
size=$(du -sb "$context" | cut -f 1)
[ "$size" -lt 60000000 ] || die "the image would have $size bytes"
image build --quiet --isolation chroot --file Containerfile --tag lightpath "$context" >/dev/null
say "$(image images --format '{{.Size}}' lightpath)"
container=$(image from lightpath)
program=$(image inspect --format '{{index .OCIv1.Config.Entrypoint 0}}' "$container")

# Any folder may be the caller's.
work=$scratch/work
mkdir "$work" "$scratch/outside"
cp -r scenes assets "$work"
chmod 755 "$scratch"
chown -R 65534:65534 "$work"
lightpath() {
    image run --isolation chroot --user 65534:65534 --volume "$work:/work" "$container" "$program" "$@"
}
lightpath --version --verbose
for input in scenes/still-life.json assets/teapot.ply; do
    options=(render "$input" --size 320x240 --spp 4 --quiet)
    lightpath "${options[@]}" -o /work/inside
    "$outside" "${options[@]}" -o "$scratch/outside/inside"
    for file in "$scratch"/outside/*; do
        cmp "$file" "$work/${file##*/}"
        say "the same bytes: $input, ${file##*.}, $(stat -c %s "$file")"
    done
done
