#!/bin/bash
# Makes the packages of HEAD twice and compares their bytes. The two builds differ in the folder, the
# umask, the time zone, the language, the file system of temporary files, and the day, for which
# `faketime` is needed (apt-get install faketime). By hand: two whole builds, some 5 minutes each.
#
# reproducible.sh all   the packages of `make portable`, which must have run once, and the wheel, too: some 15 minutes
#                       each. The wheel is made on the same day, as pip refuses the certificates of another.
set -euo pipefail
cd "$(dirname "$0")/.."
source=$PWD
what=${1:-dist}
commit=$(git rev-parse HEAD)
export PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
unset CARGO_TARGET_DIR SOURCE_DATE_EPOCH RUSTFLAGS EMBREE_DIR
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

say() { printf 'reproducible: %s\n' "$*"; }
command -v faketime >/dev/null || { say "found no faketime: apt-get install faketime" >&2; exit 2; }

sbom=$source/target/portable-tools/bin/cargo-cyclonedx
[ "$what" != all ] || [ -x "$sbom" ] || { say "found no $sbom: make portable" >&2; exit 2; }

# rustc hangs under faketime. It reads no clock, so it gets the real one.
printf '#!/bin/sh\nunset LD_PRELOAD\nexec %s "$@"\n' "$(command -v rustc)" >"$scratch/rustc"
chmod +x "$scratch/rustc"
export RUSTC=$scratch/rustc

# packages FOLDER TIME VARIABLE=VALUE...
packages() (
    git clone --quiet "$source" "$1"
    [ ! -d vendor ] || cp -a vendor "$1"
    cd "$1"
    git checkout --quiet --detach "$commit"
    export "${@:3}"
    say "$(faketime -f "$2" date +%F), $PWD"
    faketime -f "$2" cargo build --quiet --locked --release
    faketime -f "$2" scripts/dist.sh
    [ "$what" = all ] || return 0
    scripts/python.sh wheel
    # shellcheck source=scripts/zig.sh
    . scripts/zig.sh
    cp "$sbom" target/portable-tools/bin
    faketime -f "$2" scripts/portable.sh
)
(umask 022 && packages "$scratch/one" +0 LC_ALL=C TZ=UTC)
(umask 077 && packages "$scratch/some/other/folder" +40d LC_ALL=C.UTF-8 TZ=Pacific/Auckland TMPDIR=/dev/shm)

same=0
shopt -s nullglob
for file in "$scratch/one/target/release/lightpath" "$scratch/one"/target/{dist,wheels}/*; do
    other=$scratch/some/other/folder/${file#"$scratch/one/"}
    if cmp "$file" "$other"; then
        say "the same $(stat -c %s "$file") bytes: ${file##*/}, SHA-256 $(sha256sum "$file" | cut -c 1-16)"
    else
        same=1
    fi
done
exit $same
