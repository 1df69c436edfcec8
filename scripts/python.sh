#!/bin/bash
# Builds and tests the Python package. `python.sh test` puts it into a virtual environment that is
# kept under target/; `python.sh wheel` makes a wheel and tests it in a fresh one. `MACHINE=aarch64
# python.sh wheel` makes a wheel for 64-bit ARM in target/wheels-aarch64/, and inspects it.
set -euo pipefail
cd "$(dirname "$0")/.."
scripts/setup.sh python
# As in the Makefile.
export PYO3_BUILD_EXTENSION_MODULE=1
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
python=${PYTHON:-python3}

# Makes a virtual environment with pip, unless the folder has one that works, and installs packages in it.
# Its scripts name its folder, which may have been another one: pip and pytest are run as modules.
environment() {
    local folder=$1
    shift
    "$folder/bin/python" -m pip --version >/dev/null 2>&1 || "$python" -m venv --clear "$folder"
    "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$@"
}

run_tests() {
    # In a folder without the sources, so that the installed package is tested. Embree is found where
    # `make setup` puts it.
    local tests=$PWD/python/tests embree=$PWD/vendor/embree
    export LD_LIBRARY_PATH=$embree${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
    (cd "$target" && PYTHONPATH=$tests "$1/bin/python" -m pytest -q -p no:cacheprovider "$tests")
}

# Prints the processor and the newest glibc symbols of the module in a wheel.
inspect() {
    local folder
    folder=$(mktemp -d)
    "$python" -m zipfile -e "$1" "$folder"
    readelf -h "$folder"/lightpath/_lightpath*.so | grep Machine
    readelf -V "$folder"/lightpath/_lightpath*.so | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -n 1
    rm -r "$folder"
}

case ${1:-test} in
test)
    venv=$target/python-venv
    environment "$venv" numpy pytest hypothesis
    # The library is the one of the program, compiled once.
    cargo build --locked --release --package lightpath-python --target-dir "$target"
    packages=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')
    rm -rf "$packages/lightpath"
    cp -r python/lightpath "$packages/lightpath"
    rm -f "$packages/lightpath/_lightpath".*so
    cp "$target/release/lib_lightpath.so" "$packages/lightpath/_lightpath.abi3.so"
    run_tests "$venv"
    ;;
wheel)
    builder=$target/python-builder
    # Zig links against the symbols of an old glibc, which decide on which systems the wheel runs.
    environment "$builder" 'maturin[zig]>=1.8,<2'
    own=$(uname -m) machine=${MACHINE:-$(uname -m)} wheels=$target/wheels
    if [ "$machine" != "$own" ]; then
        wheels=$target/wheels-$machine
        command -v rustup >/dev/null ||
            { echo "python: found no rustup, which installs Rust's libraries for $machine: https://rustup.rs" >&2; exit 2; }
        rustup target add "$machine-unknown-linux-gnu"
    fi
    # shellcheck source=scripts/remap.sh
    . scripts/remap.sh
    rm -rf "$wheels"
    PATH=$builder/bin:$PATH "$builder/bin/maturin" build --release --locked --zig \
        --target "$machine-unknown-linux-gnu" --compatibility "${COMPATIBILITY:-manylinux_2_28}" \
        --manifest-path python/Cargo.toml --target-dir "$target" --out "$wheels" \
        --interpreter "$python"
    if [ "$machine" != "$own" ]; then
        inspect "$wheels"/*.whl
        exit
    fi
    "$builder/bin/maturin" sdist --manifest-path python/Cargo.toml --out "$target/wheels"
    # A wheel that is made of the source distribution describes itself in the same words.
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    tar -xf "$wheels"/*.tar.gz -C "$scratch" --strip-components 1
    "$python" -m zipfile -e "$wheels"/*.whl "$scratch/wheel"
    (cd "$scratch" && PATH=$builder/bin:$PATH maturin pep517 write-dist-info --metadata-directory "$scratch/made" \
        --interpreter "$python" >/dev/null)
    cmp "$scratch"/wheel/*.dist-info/METADATA "$scratch"/made/*.dist-info/METADATA
    venv=$target/wheel-venv
    rm -rf "$venv"
    environment "$venv" pytest hypothesis "$target"/wheels/*.whl
    run_tests "$venv"
    "$venv/bin/lightpath" --version
    ls -l "$target/wheels"
    ;;
*)
    echo "usage: $0 [test|wheel]" >&2
    exit 2
    ;;
esac
