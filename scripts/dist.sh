#!/bin/sh
# Packages what `make build` compiled, into target/dist/:
#
#   lightpath_VERSION-1~SYSTEM_ARCH.deb
#       for the system that it is made on, such as debian12;
#       depends on libembree4-4 where the distribution has it (Debian 13); else contains the Embree
#       of vendor/embree in /usr/lib/lightpath
#   lightpath-VERSION-ARCH-linux.tar.xz
#       a folder that runs anywhere, with Embree if that is in vendor/
#
# With EMBREE=none neither contains Embree, for a Debian 13 package made on Debian 12. With EMBREE_DIR,
# EMBREE must say whose Embree they contain: EMBREE=$EMBREE_DIR/lib. Both are made with `make install`. The
# same commit and folders of Rust give the same bytes: scripts/reproducible.sh. MAINTAINER is who answers
# for the .deb: "NAME <ADDRESS>". XZ_LEVEL is from 0 (fast) to 9. Needs xz; without dpkg-deb there is no .deb.
# SHA256SUMS is of all files of this version.
set -eu
cd "$(dirname "$0")/.."
export LC_ALL=C

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
machine=$(uname -m)
dist=${CARGO_TARGET_DIR:-target}/dist
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH
if [ -n "${EMBREE_DIR:-}" ] && [ ! -d "${EMBREE:-none}" ]; then
    printf 'dist: %s\n' "EMBREE_DIR is $EMBREE_DIR, a folder of this machine: a package must carry that Embree." \
        "Run \`EMBREE=FOLDER make dist\` with the folder of its libraries, or unset EMBREE_DIR." >&2
    exit 2
fi
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
umask 022
mkdir -p "$dist"
rm -f "$dist/SHA256SUMS"

say() { printf 'dist: %s\n' "$*"; }
install_to() {
    make --no-print-directory install DESTDIR="$1" PREFIX="$2" EMBREE="${EMBREE:-vendor/embree}" >/dev/null
}
# KiB of all files, each rounded up. `du` also counts folders, whose sizes depend on the file system.
installed_size() { find "$1" -type f -printf '%s\n' | awk '{ sum += int(($1 + 1023) / 1024) } END { print sum }'; }
same_times() { find "$1" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +; }

# --------------------------------------------------------------------------------------------------
# The folder

scripts/folder.sh "$dist" "lightpath-$version-$machine-linux" "${EMBREE:-vendor/embree}"

# --------------------------------------------------------------------------------------------------
# The package

if ! command -v dpkg-deb >/dev/null; then
    say "no .deb: this system has no dpkg-deb"
    scripts/sums.sh "$dist" "$version"
    exit
fi
architecture=$(dpkg --print-architecture)
deb=$stage/deb
install_to "$deb" /usr
# Where Debian's zsh looks. Other systems have site-functions.
mv "$deb/usr/share/zsh/site-functions" "$deb/usr/share/zsh/vendor-completions"
# The newest version of the C library that a symbol of the program needs.
glibc=$(grep -ao 'GLIBC_2\.[0-9]*' "$deb/usr/bin/lightpath" | sort -V | tail -n 1 | sed 's/GLIBC_//')
depends="libc6 (>= $glibc), libgcc-s1"
if [ -d "$deb/usr/lib/lightpath" ]; then
    depends="$depends, libstdc++6"
    carries=" It carries Embree 4 and TBB (Apache-2.0) in /usr/lib/lightpath."
else
    depends="$depends, libembree4-4 (>= 4.3)"
    carries=
fi
# Another system makes another package of this version. apt takes that of a newer release for the newer one,
# and the one without Embree for older than that.
# shellcheck source=/dev/null
system=$([ ! -r /etc/os-release ] || . /etc/os-release; printf '%s%s' "${ID:-linux}" "${VERSION_ID:-}")
[ "${EMBREE:-}" != none ] || system=$system~noembree
revision=$version-1~$system
maintainer=${MAINTAINER:-lightpath <lightpath@localhost>}
doc=$deb/usr/share/doc/lightpath
paragraphs() { sed 's/^ *$/./; s/^/ /'; }
{
    printf 'Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\n'
    printf 'Upstream-Name: lightpath\n'
    printf 'Comment: What the program contains of others is in THIRD_PARTY.md and THIRD_PARTY_LICENSES.txt.\n'
    printf '\nFiles: *\nCopyright: 2026 The lightpath authors\nLicense: Expat or Apache-2.0\n'
    printf '\nFiles: usr/share/doc/lightpath/assets/*\n'
    printf 'Copyright: Keenan Crane (spot), Martin Newell (teapot), the lightpath authors\n'
    printf 'License: CC0-1.0 and public-domain and (Expat or Apache-2.0)\nComment: assets/README.md has the sources.\n'
    printf '\nLicense: CC0-1.0\n The text is in /usr/share/common-licenses/CC0-1.0.\n'
    printf '\nLicense: public-domain\n The teapot is in the public domain.\n'
    if [ -n "$carries" ]; then
        printf '\nFiles: usr/lib/lightpath/*\n'
        printf 'Copyright: Intel Corporation\n 2009 Stanford University, and authors\n'
        printf 'License: Apache-2.0 and BSD-3-Clause\n'
        printf '\nLicense: BSD-3-Clause\n'
        sed -n '/^### Syrah/,/^## /{/^##/!p}' THIRD_PARTY.md | paragraphs
    fi
    printf '\nLicense: Expat\n'
    sed '1,/^Copyright/d' LICENSE-MIT | sed 1d | paragraphs
    printf '\nLicense: Apache-2.0\n The text is in /usr/share/common-licenses/Apache-2.0.\n'
} >"$doc/copyright"
gzip -9n <CHANGELOG.md >"$doc/changelog.gz"
{
    printf 'lightpath (%s) unstable; urgency=medium\n\n' "$revision"
    printf '  * Version %s: changelog.gz lists what it changes.\n\n' "$version"
    printf ' -- %s  %s\n' "$maintainer" "$(date -uRd "@$SOURCE_DATE_EPOCH")"
} | gzip -9n >"$doc/changelog.Debian.gz"
gzip -9n "$deb/usr/share/man/man1/lightpath.1"
mkdir "$deb/DEBIAN"
cat >"$deb/DEBIAN/control" <<CONTROL
Package: lightpath
Version: $revision
Section: graphics
Priority: optional
Architecture: $architecture
Maintainer: $maintainer
Installed-Size: $(installed_size "$deb/usr")
Depends: $depends
Description: CPU ray tracer for big scanned meshes
 Renders JSON scenes and PLY meshes to multi-layer EXR and PNG: with its own
 tree or Intel Embree 4, the same bytes on every run and for any number of
 threads; batches, turntables, parts of a frame on a farm.
$([ -z "$carries" ] || echo "$carries")
CONTROL
sed -i '/^$/d' "$deb/DEBIAN/control"
# For `dpkg --verify`.
(cd "$deb" && find usr -type f | sort | xargs -d '\n' md5sum >DEBIAN/md5sums)
same_times "$deb"
package=$dist/lightpath_${revision}_$architecture.deb
dpkg-deb --root-owner-group -Zxz "-z${XZ_LEVEL:-6}" --build "$deb" "$package" >/dev/null
say "$package: depends on $depends"
scripts/sums.sh "$dist" "$version"
