#!/bin/bash
# Packs a relocatable folder with `make install`: folder.sh DIST NAME EMBREE. The environment may set
# BINARY and SPEAKER of the Makefile, and XZ_LEVEL, from 0 (fast) to 9. The same program gives the same
# bytes. Needs xz.
set -euo pipefail
cd "$(dirname "$0")/.."
export LC_ALL=C
command -v xz >/dev/null || { echo 'dist: found no xz: install xz-utils' >&2; exit 2; }

dist=$1
name=$2
embree=$3
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
stage=$(mktemp -d)
# The tarball gets its name when it is complete: SHA256SUMS is of all files in the folder.
part=$dist/.$name.part
trap 'rm -rf "$stage" "$part"' EXIT
umask 022
mkdir -p "$dist"
make --no-print-directory install DESTDIR="$stage/$name" PREFIX= EMBREE="$embree" >/dev/null
install -m 644 -t "$stage/$name/share/doc/lightpath" CHANGELOG.md
tar -C "$stage" --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner -cf - "$name" |
    xz "-${XZ_LEVEL:-6}" -T2 --block-size=16MiB >"$part"
mv "$part" "$dist/$name.tar.xz"

# The newest version of the C library that a symbol of the program needs; a static one needs none.
symbols=$(grep -ao 'GLIBC_2\.[0-9]*' "$stage/$name/bin/lightpath" || true)
glibc=$(sort -V <<<"$symbols" | tail -n 1 | sed 's/GLIBC_//')
needs="; needs ${glibc:+glibc }${glibc:-nothing else}"
if [ -d "$stage/$name/lib/lightpath" ]; then
    printf 'dist: %s: with Embree, which needs libstdc++%s\n' "$dist/$name.tar.xz" "$needs"
else
    printf 'dist: %s: without Embree%s\n' "$dist/$name.tar.xz" "$needs"
fi
