#!/bin/bash
# Copies the program, Embree, licences, guide, examples, man page and completions: install.sh DESTINATION, for
# `make install`; `make uninstall` removes them. From the environment: BINARY, the program; SPEAKER, a program
# of the same version that runs here; EMBREE, a folder with the libraries of Embree 4, which may be missing.
set -euo pipefail
cd "$(dirname "$0")/.."
destination=$1
umask 022
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

put() { # MODE FILE FOLDER
    mkdir -p "$destination/$3"
    install -m "$1" "$2" "$destination/$3"
    printf 'install: %s\n' "$destination/$3/${2##*/}"
}

# A package goes to other machines, where anybody may own a folder of that name.
if [ -n "${DESTDIR:-}" ] && [ -n "${EMBREE_DIR:-}" ] && [ ! -d "$EMBREE" ]; then
    printf 'install: %s\n' "EMBREE_DIR is $EMBREE_DIR, a folder of this machine: a package must carry that Embree." \
        "Name the folder of its libraries, EMBREE=FOLDER, or unset EMBREE_DIR." >&2
    exit 2
fi

# Everything that can fail comes first, so that a failure leaves no half of an installation.
"$SPEAKER" man >"$scratch/lightpath.1"
"$SPEAKER" completions bash >"$scratch/lightpath"
"$SPEAKER" completions zsh >"$scratch/_lightpath"
"$SPEAKER" completions fish >"$scratch/lightpath.fish"

# Their links to each other work as in the checkout, of which nothing else is taken. A source package has no
# list of git's.
documents=$(git ls-files README.md docs/README.md docs/guide scenes assets 2>/dev/null || true)
[ -n "$documents" ] || documents=$(find README.md docs/README.md docs/guide scenes assets -type f)

mkdir "$scratch/bin"
cp "$BINARY" "$scratch/bin/lightpath"
# Nobody debugs with the symbols of a package. Zig's programs have none.
if [ -n "${DESTDIR:-}" ] && [[ $(readelf -S "$scratch/bin/lightpath") == *.symtab* ]]; then
    strip "$scratch/bin/lightpath" || echo "install: the program keeps its symbols" >&2
fi

# The loader asks for libraries by their sonames, which end after the first number.
libraries=()
if [ -d "$EMBREE" ]; then
    for library in "$EMBREE"/libembree4*.so.4 "$EMBREE"/libtbb*.so.{2,12}; do
        [ ! -e "$library" ] || libraries+=("$library")
    done
    [[ "${libraries[*]}" == *libembree4* ]] || { echo "install: no libembree4.so.4 in $EMBREE" >&2; exit 1; }
fi
for library in "${libraries[@]}"; do
    to=$destination/lib/lightpath/${library##*/}
    linked=$(readlink "$library" || true)
    # A second name of another library stays a link. All others become files.
    if [[ " ${libraries[*]##*/} " == *" $linked "* ]]; then
        mkdir -p "${to%/*}"
        ln -sfn "$linked" "$to"
    else
        put 644 "$library" lib/lightpath
    fi
done

put 755 "$scratch/bin/lightpath" bin
for file in LICENSE-MIT LICENSE-APACHE THIRD_PARTY.md THIRD_PARTY_LICENSES.txt; do
    put 644 "$file" share/doc/lightpath
done
for file in $documents; do
    put 644 "$file" "share/doc/lightpath/$(dirname "$file")"
done
put 644 farm/openjd-template.yaml share/lightpath/farm
put 644 "$scratch/lightpath.1" share/man/man1
put 644 "$scratch/lightpath" share/bash-completion/completions
put 644 "$scratch/_lightpath" share/zsh/site-functions
put 644 "$scratch/lightpath.fish" share/fish/vendor_completions.d
