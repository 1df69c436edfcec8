#!/usr/bin/env python3
"""Makes the list of what the packages contain of the one that cargo-cyclonedx writes.

    scripts/sbom.py FOUND CLEAN     called by scripts/portable.sh

Of one commit it has the same bytes: without the folder, the day and the random number of the run. Crates that are no
part of the program are left out: build tools, and those of features that no package has. Libraries that are no crates
are added.
"""

import glob
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from urllib.parse import quote

from licences import ROOT, crates

TARGET = os.environ.get("CARGO_TARGET_DIR") or os.path.join(ROOT, "target")
DYNAMIC = "lightpath_*.deb, *-linux.tar.xz, *-glibc2.28.tar.xz"


def contents(path):
    with open(path, "rb") as file:
        return file.read()


def library(name, version, licence, purl, packages, path=None):
    """Returns the component of a library that is no crate, with the hash of its file if there is one."""
    component = {
        "type": "library",
        "bom-ref": f"{name}@{version}",
        "name": name,
        "version": version,
        "scope": "required",
        "licenses": [{"expression": licence}],
        "purl": purl,
        "properties": [{"name": "lightpath:packages", "value": packages}],
    }
    if path:
        component["hashes"] = [{"alg": "SHA-256", "content": hashlib.sha256(contents(path)).hexdigest()}]
    return component


def text(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def found(pattern, where):
    return re.search(pattern, where).group(1)


def embree():
    """Returns the components of the libraries in vendor/embree/, none without that folder."""
    folder = os.path.join(ROOT, "vendor/embree")
    if not os.path.isdir(folder):
        return []
    (embree,) = glob.glob(os.path.join(folder, "libembree4-*"))
    (tbb,) = glob.glob(os.path.join(folder, "libtbb-*"))
    version = found(r"embreex==([0-9]+[.][0-9]+[.][0-9]+)", text(os.path.join(ROOT, "scripts/setup.sh")))
    tbb_version = found(rb"oneTBB: VERSION\s+([0-9.]+)", contents(tbb)).decode()
    return [
        library("embree", version, "Apache-2.0", f"pkg:github/renderkit/embree@v{version}", DYNAMIC, embree),
        library("oneTBB", tbb_version, "Apache-2.0", f"pkg:github/uxlfoundation/onetbb@v{tbb_version}", DYNAMIC, tbb),
    ]


def compiled_in(part):
    """Returns the components of Rust's standard library and of the C libraries that crates compile."""
    folders = {name: (version, os.path.dirname(package["manifest_path"])) for (name, version), package in part.items()}
    zstd = folders["zstd-sys"][0].partition("+zstd.")[2]
    header = os.path.join(folders["libdeflate-sys"][1], "libdeflate/libdeflate.h")
    deflate = found(r'LIBDEFLATE_VERSION_STRING\s+"([0-9.]+)"', text(header))
    rust = subprocess.run([os.environ.get("RUSTC", "rustc"), "--version"], check=True, stdout=subprocess.PIPE,
                          encoding="utf-8").stdout.split()[1]
    return [
        library("zstd", zstd, "BSD-3-Clause", f"pkg:github/facebook/zstd@v{zstd}", "all"),
        library("libdeflate", deflate, "MIT", f"pkg:github/ebiggers/libdeflate@v{deflate}", "all"),
        library("rust-std", rust, "MIT OR Apache-2.0", f"pkg:github/rust-lang/rust@{rust}", "all"),
    ]


def linked():
    """Returns the components that Zig brings."""
    (zig,) = glob.glob(os.path.join(TARGET, "portable-tools/lib/python3*/site-packages/ziglang"))
    musl = found(r'VERSION "([0-9.]+)"', text(os.path.join(zig, "lib/libc/musl/src/internal/version.h")))
    clang = subprocess.run([os.path.join(zig, "zig"), "clang", "--version"], check=True, stdout=subprocess.PIPE)
    llvm = found(rb"version ([0-9.]+)", clang.stdout).decode()
    return [
        library("musl", musl, "MIT", f"pkg:generic/musl@{musl}", "*-static.tar.xz"),
        library("llvm-runtimes", llvm, "Apache-2.0 WITH LLVM-exception",
                f"pkg:github/llvm/llvm-project@llvmorg-{llvm}", "*-static.tar.xz, *-glibc2.28.tar.xz"),
    ]


def main():
    path, clean = sys.argv[1:]
    written = text(path).replace("path+file://" + quote(ROOT), "path+file:///lightpath")
    # A package URL names no folder, and its versions have no plain `+`.
    written = re.sub(r"[?]download_url=file://[^#\"]*", "", written)
    written = re.sub(r'"pkg:cargo/[^"]*"', lambda url: url[0].replace("+", "%2B"), written)
    bom = json.loads(written)
    del bom["serialNumber"]
    epoch = int(os.environ["SOURCE_DATE_EPOCH"])
    bom["metadata"]["timestamp"] = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(epoch))

    part = crates(["Cargo.toml"])
    compiled = [component for component in bom["components"] if (component["name"], component["version"]) in part]
    missing = set(part) - {(component["name"], component["version"]) for component in compiled}
    if missing:
        sys.exit(f"sbom: cargo-cyclonedx has not found {sorted(missing)}")
    added = embree() + compiled_in(part) + linked()
    bom["components"] = compiled + added

    own = bom["metadata"]["component"]["bom-ref"]
    kept = {own} | {component["bom-ref"] for component in bom["components"]}
    bom["dependencies"] = [
        {"ref": entry["ref"], "dependsOn": [ref for ref in entry["dependsOn"] if ref in kept]}
        for entry in bom["dependencies"] if entry["ref"] in kept
    ]
    bom["dependencies"] += [{"ref": component["bom-ref"], "dependsOn": []} for component in added]
    (program,) = [entry for entry in bom["dependencies"] if entry["ref"] == own]
    program["dependsOn"] += [component["bom-ref"] for component in added]
    with open(clean, "w", encoding="utf-8") as file:
        json.dump(bom, file, indent=2)


if __name__ == "__main__":
    main()
