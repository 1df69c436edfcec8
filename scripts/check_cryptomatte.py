#!/usr/bin/env python3
"""Checks the cryptomattes of an EXR against their specification 1.2.0: `pip install OpenEXR numpy`.

check_cryptomatte.py FILE.exr [NAME...]     NAMEs must be among the mattes

Reads with OpenEXR's own library and uses no code of lightpath. Exit code 1 and a line for each mistake.
"""
import json
import os
import re
import sys
from collections import defaultdict

import numpy as np
import OpenEXR

MASK = 0xFFFFFFFF


def murmur3(data, seed=0):
    """MurmurHash3_x86_32 (Austin Appleby, public domain)."""

    def mix(k):
        k = k * 0xCC9E2D51 & MASK
        return (k << 15 | k >> 17) * 0x1B873593 & MASK

    h = seed
    whole = len(data) // 4 * 4
    for i in range(0, whole, 4):
        h ^= mix(int.from_bytes(data[i : i + 4], "little"))
        h = ((h << 13 | h >> 19) * 5 + 0xE6546B64) & MASK
    if data[whole:]:
        h ^= mix(int.from_bytes(data[whole:], "little"))
    h ^= len(data)
    h = (h ^ h >> 16) * 0x85EBCA6B & MASK
    h = (h ^ h >> 13) * 0xC2B2AE35 & MASK
    return h ^ h >> 16


def matte_id(name):
    """Returns the bits of a name's id, without an exponent of 0 or 255."""
    h = murmur3(name.encode())
    return h ^ 1 << 23 if h >> 23 & 255 in (0, 255) else h


# Known values of the hash and of the rule for exponents.
assert murmur3(b"torus") == 4053562365 and matte_id("bunny") == 0x13851A76


def check(path, wanted=()):
    """Returns the mistakes and the areas found, by kind of matte."""
    wrong, found = [], {}
    kinds, channels = defaultdict(dict), {}
    for part in OpenEXR.File(path, separate_channels=True).parts:
        for key, value in part.header.items():
            match = re.fullmatch(r"cryptomatte/([^/]+)/([^/]+)", key)
            if match:
                kinds[match[1]][match[2]] = value
        channels.update({name: channel.pixels for name, channel in part.channels.items()})
    if not kinds:
        wrong.append("no cryptomatte in the header")
    for key, said in kinds.items():
        kind = said.get("name", "")
        if len(key) > 7:
            wrong.append(f"the key {key} has more than 7 characters")
        for what, expected in [("hash", "MurmurHash3_32"), ("conversion", "uint32_to_float32")]:
            if said.get(what) != expected:
                wrong.append(f"{kind}: {what} is {said.get(what)}")
        manifest = said.get("manifest")
        if "manif_file" in said:
            with open(os.path.join(os.path.dirname(path), said["manif_file"]), encoding="utf-8") as file:
                manifest = file.read()
        names = json.loads(manifest) if manifest else {}
        wrong += [f"{kind}: {n} is {h}" for n, h in names.items() if int(h, 16) != matte_id(n)]
        ranks = []
        while all(f"{kind}{len(ranks) // 2:02}.{c}" in channels for c in "RGBA"):
            r, g, b, a = (channels[f"{kind}{len(ranks) // 2:02}.{c}"] for c in "RGBA")
            if any(pixels.dtype != np.float32 for pixels in (r, g, b, a)):
                wrong.append(f"{kind}: a channel is not 32-bit float")
                break
            ranks += [(r.view(np.uint32), g), (b.view(np.uint32), a)]
        if not ranks:
            wrong.append(f"{kind}: no channels")
            continue
        coverage = sum(c.astype(np.float64) for _, c in ranks)
        if coverage.min() < 0 or coverage.max() > 1 + 1e-5:
            wrong.append(f"{kind}: coverage from {coverage.min()} to {coverage.max()}")
        if any((b > a + 1e-6).any() for (_, a), (_, b) in zip(ranks, ranks[1:])):
            wrong.append(f"{kind}: ranks are not sorted by coverage")
        area = defaultdict(float)
        for ids, covered in ranks:
            exponent = ids >> 23 & 255
            if ((ids != 0) & ((exponent == 0) | (exponent == 255))).any():
                wrong.append(f"{kind}: an id is a denormal, an infinity or a NaN")
            for one in np.unique(ids[covered > 0]):
                area[int(one)] += float(covered[ids == one].sum())
        by_id = {int(h, 16): name for name, h in names.items()}
        wrong += [f"{kind}: {one:08x} has no name" for one in area if one not in by_id]
        found[kind] = {by_id.get(one, "?"): round(pixels, 3) for one, pixels in area.items()}
    mattes = {name for kind in found.values() for name in kind}
    wrong += [f"no matte covers {name}" for name in wanted if name not in mattes]
    return wrong, found


if __name__ == "__main__":
    mistakes, mattes = check(sys.argv[1], sys.argv[2:])
    for kind, areas in mattes.items():
        print(kind, areas)
    for line in mistakes:
        print("wrong:", line)
    sys.exit(bool(mistakes))
