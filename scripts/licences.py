#!/usr/bin/env python3
"""Writes THIRD_PARTY_LICENSES.txt: the licences of the crates in the program and in the Python module.

    scripts/licences.py     after a change of Cargo.lock

The texts are the files that the crates carry. Where MIT is one of several to choose from, it is taken. The same
lock files give the same bytes.
"""

import json
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TARGETS = ("x86_64-unknown-linux-gnu", "aarch64-unknown-linux-musl")
IS_LICENCE = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense)", re.IGNORECASE)
HEAD = """\
Licences of the Rust crates that are compiled into lightpath and its Python module, as these crates carry them, and of
Rust's standard library. Where MIT is one of several licences to choose from, it is the one taken. THIRD_PARTY.md lists
the crates by licence, and all software of others that is no crate.

Made by scripts/licences.py.
"""
# Crates that carry no text, and the crate of the same authors that does.
TEXT_OF = {"embedded-graphics-core": "embedded-graphics", "pulp-wasm-simd-flag": "pulp", "zune-inflate": "zune-core"}
# The crates that the standard library links and that are not in the list anyway.
STANDARD = """\
Copyright (c) The Rust Project Contributors
Copyright (c) 2014 Alex Crichton
Copyright (c) 2015 The Gimli Developers
Copyright (c) 2015 The Rust Project Developers
Copyright (c) 2016-2018 The gimli Developers

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
persons to whom the Software is furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
"""


def cargo(*arguments):
    command = ["cargo", *arguments, "--locked"]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, encoding="utf-8").stdout


def crates(manifests=("Cargo.toml", "python/Cargo.toml")):
    """Returns the packages, as `cargo metadata` describes them, by (name, version)."""
    found = {}
    for manifest in manifests:
        every = json.loads(cargo("metadata", "--format-version", "1", "--manifest-path", manifest))["packages"]
        every = {(package["name"], package["version"]): package for package in every}
        for target in TARGETS:
            tree = cargo("tree", "--edges", "normal", "--prefix", "none", "--format", "{p}", "--manifest-path", manifest,
                         "--target", target)
            for line in tree.splitlines():
                name, version = line.split()[:2]
                package = every[name, version.removeprefix("v")]
                if package["source"]:
                    found[name, package["version"]] = package
    return found


def texts(package):
    """Returns the texts of a crate's licence."""
    folder = os.path.dirname(package["manifest_path"])
    names = [name for name in os.listdir(folder) if IS_LICENCE.match(name)]
    for inner in [name for name in names if os.path.isdir(os.path.join(folder, name))]:
        names.remove(inner)
        names += [os.path.join(inner, name) for name in os.listdir(os.path.join(folder, inner))]
    if any("MIT" in name.upper() for name in names) and " OR " in package["license"].replace("/", " OR "):
        names = [name for name in names if not re.search("APACHE|UNLICENSE|BSD|ZLIB", name.upper())]
    found = []
    for name in sorted(names):
        with open(os.path.join(folder, name), encoding="utf-8") as file:
            found.append("\n".join(line.rstrip() for line in file.read().strip("\ufeff\n").splitlines()) + "\n")
    return found


def main():
    packages = crates()
    named = {name: package for (name, _), package in packages.items()}
    users = {}
    for (name, version), package in sorted(packages.items()):
        of_crate = texts(package) or texts(named[TEXT_OF[name]])
        for text in of_crate:
            # Texts that differ in their line breaks alone are one.
            names = users.setdefault(" ".join(text.split()), (text, {}))[1]
            names[f"{name} {version}"] = None
    sections = sorted((list(names), text) for text, names in users.values())
    sections = [(", ".join(names), text) for names, text in sections]
    sections.append(("Rust's standard library, with addr2line, gimli, object and rustc-demangle", STANDARD))
    with open(os.path.join(ROOT, "THIRD_PARTY_LICENSES.txt"), "w", encoding="utf-8") as file:
        file.write(HEAD)
        for names, text in sections:
            file.write(f"\n{'=' * 80}\n{names}\n{'=' * 80}\n\n{text}")


if __name__ == "__main__":
    main()
