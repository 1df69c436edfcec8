#!/bin/sh
# Installs what lightpath needs to be built and run, and announces each step. Running it again is
# quick and changes nothing.
#
#   scripts/setup.sh         a Rust compiler, a linker, Embree 4
#   scripts/setup.sh lint    the same, and what `make lint` needs: rustfmt, clippy, shellcheck
#   scripts/setup.sh python  only what the Python package needs beside Rust: Python and venv
#
# Packages come from apt (as root, or with sudo). If the distribution's Rust or Embree is too old,
# Rust comes from rustup, and Embree from a checksummed Python wheel into vendor/embree/. The wheel
# changes nothing outside this folder. EMBREE_DIR=/folder names an Embree 4 of your own.
set -eu

rust_needed=1.85
# The script of https://sh.rustup.rs, from the host of all other Rust downloads.
rustup_script=https://static.rust-lang.org/rustup/rustup-init.sh
embree_needed=4.3

# The wheel that contains RenderKit's own build of Embree 4.4.0 with its oneTBB, for any x86-64
# Linux with glibc 2.28. Its Python version does not matter: only these two files are extracted.
wheel=embreex==4.4.0.post1
wheel_sha256=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f
embree_file=libembree4-4aef3270.so.4
embree_sha256=aa4eb9d81e30237d032418832efd9caee19bead50f49939fb08347a053898c7a
tbb_file=libtbb-dcf63f8c.so.12
tbb_sha256=08d7ce01dcce5c49f874ee91ba8dad75ee3aa1838d5ce8a92f5b2ec98b9df2ed

cd "$(dirname "$0")/.."
root=$(pwd)
vendor=$root/vendor/embree
export DEBIAN_FRONTEND=noninteractive
PATH=${CARGO_HOME:-${HOME:-/root}/.cargo}/bin:$PATH
scratch=
trap 'if [ -n "$scratch" ]; then rm -rf "$scratch"; fi' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP

say() { printf 'setup: %s\n' "$*"; }
die() {
    printf 'setup: %s\n' "$@" >&2
    exit 2
}
have() { command -v "$1" >/dev/null 2>&1; }

# at_least 4.3.3 4.3: succeeds if the first version is not older than the second
at_least() {
    [ "$(printf '%s\n%s\n' "$2" "$1" | sort -V | head -n 1)" = "$2" ]
}

# --------------------------------------------------------------------------------------------------
# Packages

can_be_root() {
    [ "$(id -u)" = 0 ] || have sudo
}

as_root() {
    if [ "$(id -u)" = 0 ]; then
        "$@"
    else
        # sudo drops the environment, including DEBIAN_FRONTEND.
        sudo DEBIAN_FRONTEND=noninteractive "$@"
    fi
}

package_lists=old
refresh_package_lists() {
    if [ $package_lists = old ]; then
        say "reading the package lists (apt-get update)"
        as_root apt-get update -qq || say "apt-get update failed: continuing with the present lists"
        package_lists=new
    fi
}

# apt_install REASON PACKAGE...
apt_install() {
    reason=$1
    shift
    have apt-get || die "missing: $* ($reason)." \
        "This system has no apt-get: install that with its own package manager, and run this again."
    can_be_root || die "missing: $* ($reason). This needs root, and there is no sudo. As root, run:" \
        "    apt-get update && apt-get install --no-install-recommends $*" "and then run this again."
    refresh_package_lists
    say "installing from apt: $* ($reason)"
    as_root apt-get install -y -qq --no-install-recommends "$@" >&2 ||
        die "apt-get could not install: $*" "Install that by hand, and run this again."
}

# Sets `candidate` to the version of a package that apt would install, without epoch; empty if there
# is none. A fresh container has no package lists, so they are read first.
apt_candidate() {
    candidate=
    have apt-get && have apt-cache || return 0
    candidate=$(candidate_in_lists "$1")
    if [ -z "$candidate" ] && can_be_root; then
        refresh_package_lists
        candidate=$(candidate_in_lists "$1")
    fi
}

candidate_in_lists() {
    LC_ALL=C apt-cache policy "$1" 2>/dev/null | sed -n 's/^ *Candidate: *//p' | sed 's/(none)//; s/^[0-9]*://'
}

# --------------------------------------------------------------------------------------------------
# Rust

rust_version() {
    rustc --version 2>/dev/null | sed -n 's/^rustc \([0-9.]*\).*/\1/p'
}

rust_is_here() {
    have cargo && cargo --version >/dev/null 2>&1 || return 1
    version=$(rust_version)
    [ -n "$version" ] && at_least "$version" "$rust_needed"
}

rust_from_rustup() {
    say "installing Rust with rustup into ${CARGO_HOME:-${HOME:-/root}/.cargo}, for this user only:" \
        "lightpath needs rustc $rust_needed, and $1"
    if ! have curl; then
        apt_install "downloads rustup" curl ca-certificates
    fi
    scratch=$(mktemp -d)
    curl --proto '=https' --tlsv1.2 --fail --silent --show-error --location \
        --output "$scratch/rustup-init.sh" "$rustup_script" ||
        die "$rustup_script could not be downloaded." \
            "Install Rust $rust_needed or later by hand (https://rustup.rs), and run this again."
    sh "$scratch/rustup-init.sh" -y --no-modify-path --default-toolchain stable --profile default >&2 ||
        die "rustup could not install Rust." \
            "Install Rust $rust_needed or later by hand (https://rustup.rs), and run this again."
    rm -rf "$scratch"
    scratch=
    say "Rust is in ${CARGO_HOME:-$HOME/.cargo}/bin: make finds it there, and a shell does after" \
        "\`. ${CARGO_HOME:-$HOME/.cargo}/env\`"
}

set_up_rust() {
    rust_is_here && return
    version=$(rust_version)
    if have rustup; then
        if [ -z "$version" ]; then
            say "rustup has no toolchain yet: installing stable Rust for this user"
            rustup default stable >&2 || die "rustup could not install stable Rust."
        else
            die "rustc $version is too old: lightpath needs $rust_needed or later." "Run: rustup update stable"
        fi
    elif have apt-get && can_be_root; then
        apt_candidate rustc
        if [ -n "$candidate" ] && at_least "$candidate" "$rust_needed"; then
            apt_install "the Rust compiler" cargo rustc
        else
            rust_from_rustup "the one of this system is ${version:-${candidate:-missing}}"
        fi
    else
        rust_from_rustup "the one of this system is ${version:-missing}"
    fi
    rust_is_here || die "cargo and rustc $rust_needed or later are still not found: $(rustc --version 2>&1 || true)"
}

# rustc links with cc. make can be missing only if this file is run by hand.
set_up_linker() {
    have cc || apt_install "the linker that rustc calls" gcc libc6-dev
    have make || apt_install "runs the Makefile" make
}

set_up_lint() {
    if have rustup && [ "$(command -v cargo)" = "$(dirname "$(command -v rustup)")/cargo" ]; then
        if ! cargo fmt --version >/dev/null 2>&1 || ! cargo clippy --version >/dev/null 2>&1; then
            say "installing rustfmt and clippy with rustup, for this user"
            rustup component add rustfmt clippy >&2 || die "rustup could not install rustfmt and clippy."
        fi
    else
        cargo fmt --version >/dev/null 2>&1 || apt_install "checks the format" rustfmt
        cargo clippy --version >/dev/null 2>&1 || apt_install "checks the Rust code" rust-clippy
    fi
    have shellcheck || apt_install "checks the scripts" shellcheck
}

# --------------------------------------------------------------------------------------------------
# Embree 4

embree_in() {
    for library in "$1"/libembree4*.so*; do
        [ -f "$library" ] && return 0
    done
    return 1
}

vendored_is_right() {
    [ -e "$vendor/libembree4.so.4" ] && [ -f "$vendor/$embree_file" ] && [ -f "$vendor/$tbb_file" ] &&
        checksums_are_right "$vendor"
}

checksums_are_right() {
    printf '%s  %s\n%s  %s\n' "$embree_sha256" "$1/$embree_file" "$tbb_sha256" "$1/$tbb_file" |
        sha256sum --check --status -
}

# Sets `embree` to the folder of a usable Embree 4; fails if there is none. Searches in build.rs's
# order.
embree_is_here() {
    if [ -n "${EMBREE_DIR:-}" ]; then
        for folder in "$EMBREE_DIR/lib" "$EMBREE_DIR/lib64" "$EMBREE_DIR"; do
            if embree_in "$folder"; then
                embree="$folder (EMBREE_DIR)"
                return 0
            fi
        done
        die "EMBREE_DIR is $EMBREE_DIR, but there is no libembree4.so in it or in its lib folder."
    fi
    if vendored_is_right; then
        embree=vendor/embree
        return 0
    fi
    for folder in "/usr/lib/$(uname -m)-linux-gnu" /usr/lib64 /usr/lib /usr/local/lib; do
        embree_in "$folder" || continue
        if have dpkg-query && [ -e "$folder/libembree4.so.4" ]; then
            version=$(dpkg-query -W -f '${Version}' libembree4-4 2>/dev/null | sed 's/^[0-9]*://') || version=
            [ -z "$version" ] || at_least "$version" "$embree_needed" || continue
        fi
        embree=$folder
        return 0
    done
    return 1
}

embree_by_hand() {
    die "$1" \
        "Get Embree $embree_needed or a later 4.x (https://github.com/RenderKit/embree/releases), unpack it, and run" \
        "    export EMBREE_DIR=/that/folder" \
        "before make. Or build without it: cargo build --release --no-default-features"
}

embree_from_wheel() {
    case $(uname -s)-$(uname -m) in
        Linux-x86_64) ;;
        *) embree_by_hand "there is no ready-made Embree 4 for $(uname -s) on $(uname -m)." ;;
    esac
    say "taking Embree 4.4.0 from the Python wheel $wheel (15 MB, PyPI) into vendor/embree/: $1." \
        "Nothing outside this folder changes."
    if ! python3 -m pip --version >/dev/null 2>&1; then
        apt_install "downloads the wheel" python3 python3-pip
    fi
    mkdir -p vendor
    scratch=$(mktemp -d "$root/vendor/.setup.XXXXXX")
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
        --python-version 3.11 --platform manylinux_2_28_x86_64 --dest "$scratch" "$wheel" >&2 ||
        embree_by_hand "pip could not download $wheel."
    printf '%s  %s\n' "$wheel_sha256" "$(echo "$scratch"/*.whl)" | sha256sum --check --status - ||
        embree_by_hand "the wheel $wheel does not have the expected checksum: not used."
    mkdir "$scratch/embree"
    python3 - "$scratch" "$embree_file" "$tbb_file" <<'PYTHON'
import glob, os, sys, zipfile
scratch, *names = sys.argv[1:]
with zipfile.ZipFile(glob.glob(os.path.join(scratch, "*.whl"))[0]) as wheel:
    for name in names:
        with open(os.path.join(scratch, "embree", name), "wb") as file:
            file.write(wheel.read("embreex.libs/" + name))
PYTHON
    checksums_are_right "$scratch/embree" ||
        embree_by_hand "the libraries in $wheel do not have the expected checksums: not used."
    # A link under Embree's own name, so that a program built before this step finds it, too.
    ln -s "$embree_file" "$scratch/embree/libembree4.so.4"
    rm -rf "$vendor"
    mv "$scratch/embree" "$vendor"
    rm -rf "$scratch"
    scratch=
}

set_up_embree() {
    embree_is_here && return
    apt_candidate libembree-dev
    if [ -z "$candidate" ] || ! at_least "$candidate" "$embree_needed"; then
        [ -z "$candidate" ] || candidate="Embree $candidate"
        embree_from_wheel \
            "this system's own packages have ${candidate:-no Embree}, and lightpath needs $embree_needed"
    elif can_be_root; then
        apt_install "Intel Embree 4, which traces rays" libembree-dev
    else
        embree_from_wheel "this system's own package needs root, and there is no sudo"
    fi
    embree_is_here || embree_by_hand "Embree 4 is still not found."
    # Rebuild: tests compiled without Embree would stay ignored.
    touch build.rs
}

# --------------------------------------------------------------------------------------------------

case ${1:-} in
    "" | lint) ;;
    python)
        "${PYTHON:-python3}" -c 'import ensurepip' 2>/dev/null ||
            apt_install "runs the tests of the Python package" python3 python3-venv
        exit
        ;;
    *) die "unknown argument $1: it is \`scripts/setup.sh\`, \`scripts/setup.sh lint\` or \`scripts/setup.sh python\`" ;;
esac
set_up_linker
set_up_rust
[ "${1:-}" != lint ] || set_up_lint
set_up_embree
say "ready: rustc $(rust_version), Embree 4 in $embree"
