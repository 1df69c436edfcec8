#!/usr/bin/env python3
"""Checks the layers of an EXR as a compositor reads them: `pip install OpenEXR numpy`.

check_layers.py all.exr                       sums of components and of light groups, projections
check_layers.py all.exr GROUP SCALE relit.exr also: GROUP times SCALE is the picture relit.exr

all.exr has every layer (`lightpath render --aov all`). The whole file is decoded, not only its header.
Exit code 1 and a line for each mistake.
"""
import sys

import numpy as np
import OpenEXR

COMPONENTS = ["diffuse", "specular", "ambient", "reflection", "background"]
wrong = []


def read(path):
    """Returns the header, and the channels as 64-bit arrays; integers stay integers."""
    part = OpenEXR.File(path, separate_channels=True).parts[0]
    channels = {name: channel.pixels for name, channel in part.channels.items()}
    for name, pixels in channels.items():
        if pixels.dtype.kind == "f" and not np.isfinite(pixels).all():
            wrong.append(f"{name}: NaN or infinity")
    return part.header, channels


def rgb(channels, layer=""):
    """Returns the R, G, B of a layer, or of the beauty, as one array of 64-bit floats."""
    prefix = layer + "." if layer else ""
    return np.stack([channels[prefix + c].astype(np.float64) for c in "RGB"], -1)


def compare(what, found, expected, size):
    """Compares with a tolerance of half a unit in the last place of each 16-bit float; `size` is the sum of absolute values."""
    off = np.abs(found - expected) - size / 2048 - 1e-6
    print(f"{what}: off by {np.abs(found - expected).max():.2e} at most")
    if off.max() > 0:
        y, x, c = np.unravel_index(off.argmax(), off.shape)
        wrong.append(f"{what}: {found[y, x, c]} for {expected[y, x, c]} at x {x}, y {y}")


header, channels = read(sys.argv[1])
beauty = rgb(channels)
groups = sorted(n[:-2] for n in channels if n.startswith("light_") and n.endswith(".R"))
for what, layers in [("components", COMPONENTS), ("light groups", groups)]:
    parts = [rgb(channels, layer) for layer in layers]
    compare(what, sum(parts), beauty, sum(map(np.abs, parts)) + np.abs(beauty))

z = channels["Z"]
for name in ["Z", "P.X", "P.Y", "P.Z"]:
    if channels[name].dtype != np.float32:
        wrong.append(f"{name} is {channels[name].dtype}, not 32-bit float")
for name in ["primid.id", "objectid.id"]:
    if channels[name].dtype != np.uint32:
        wrong.append(f"{name} is {channels[name].dtype}, not a 32-bit unsigned integer")
hit = z < 1e30
if ((channels["objectid.id"] > 0) != hit).any():
    wrong.append("Z and objectid do not agree on what was hit")
p = np.stack([channels[f"P.{c}"] for c in "XYZ"] + [np.ones_like(z)], -1).astype(np.float64)
camera = p @ np.array(header["worldToCamera"], np.float64).reshape(4, 4)
ndc = p @ np.array(header["worldToNDC"], np.float64).reshape(4, 4)
(x0, y0), (x1, y1) = header["displayWindow"]
left, top = header["dataWindow"][0]
with np.errstate(divide="ignore", invalid="ignore"):
    x = ndc[..., 0] / ndc[..., 3] * (x1 - x0 + 1) - left - np.arange(z.shape[1])[None, :]
    y = ndc[..., 1] / ndc[..., 3] * (y1 - y0 + 1) - top - np.arange(z.shape[0])[:, None]
outside = hit & ((x < -0.02) | (x > 1.02) | (y < -0.02) | (y > 1.02))
print(f"P through worldToNDC: {hit.sum()} points, {outside.sum()} outside of their pixels")
if outside.any():
    wrong.append("points do not project into their pixels")
depth_error = np.abs(camera[..., 2] - z)[hit] / z[hit]
print(f"P through worldToCamera: Z off by {depth_error.max():.1e} at most, relatively")
if depth_error.max() > 1e-4:
    wrong.append("Z is not the depth of P")

if len(sys.argv) > 2:
    group, scale, relit = sys.argv[2], float(sys.argv[3]), read(sys.argv[4])[1]
    parts = [rgb(channels, g) * (scale if g == "light_" + group else 1) for g in groups]
    size = sum(map(np.abs, parts)) + np.abs(rgb(relit))
    compare(f"relit, {group} x {scale}", sum(parts), rgb(relit), size)

for line in wrong:
    print("wrong:", line)
sys.exit(bool(wrong))
