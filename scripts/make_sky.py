#!/usr/bin/env python3
"""Writes assets/sky.hdr: an afternoon sky with a sun, thin clouds and dry ground, equirectangular.

usage: make_sky.py                    writes assets/sky.hdr, 512 x 256
       make_sky.py overcast|sharp OUT.hdr    for measuring: no sun and a closed cover, or a sun of its true size, 2048 x 1024

Needs Python 3 and nothing else. Every run and machine writes the same bytes.
"""

import math
import pathlib
import sys

NAME = sys.argv[1] if len(sys.argv) > 1 else "afternoon"
WIDTH, HEIGHT = (512, 256) if NAME == "afternoon" else (2048, 1024)
SUN = (math.radians(70), math.radians(28))  # azimuth from the middle, elevation
SUN_RADIUS = math.radians(1.2 if NAME == "afternoon" else 0.265)
# The irradiance of the sun stays the same.
SUN_FACTOR = 1 if NAME == "afternoon" else (1.2 / 0.265) ** 2


def direction(azimuth, elevation):
    return (math.cos(elevation) * math.sin(azimuth), math.sin(elevation), -math.cos(elevation) * math.cos(azimuth))


def mix(a, b, t):
    return tuple(p + (q - p) * t for p, q in zip(a, b))


def radiance(azimuth, elevation):
    d = direction(azimuth, elevation)
    if NAME == "overcast":
        # The CIE's overcast sky: three times as bright overhead as at the horizon.
        level = (1 + 2 * d[1]) / 3 if d[1] > 0 else 0.15
        return (0.95 * level, level, 1.05 * level)
    cosine = sum(p * q for p, q in zip(d, direction(*SUN)))
    if d[1] < 0:
        return mix((0.32, 0.28, 0.22), (0.12, 0.10, 0.08), min(1, -d[1] * 2))
    color = mix((0.75, 0.78, 0.85), (0.16, 0.30, 0.62), min(1, d[1] ** 0.5 * 1.2))
    glow = math.exp((cosine - 1) * 12)
    color = tuple(c + g * glow for c, g in zip(color, (1.6, 1.1, 0.6)))
    # Clouds in a plane overhead.
    x, z = d[0] / (d[1] + 0.2), d[2] / (d[1] + 0.2)
    waves = sum(math.sin(f * x + 1.7 * f) * math.sin(0.8 * f * z + f * f) / f for f in (2.1, 4.3, 8.9, 17.3))
    cover = max(0, min(1, waves * 0.9)) * min(1, d[1] * 4)
    color = mix(color, (1.1, 1.08, 1.05), 0.7 * cover)
    # The border of the sun is as wide as a texel.
    angle = math.acos(max(-1, min(1, cosine)))
    inside = max(0, min(1, (SUN_RADIUS - angle) / (2 * math.pi / WIDTH) + 0.5))
    return mix(color, tuple(SUN_FACTOR * c for c in (2600, 2100, 1400)), inside)


def rgbe(color):
    largest = max(color)
    if largest < 1e-32:
        return bytes(4)
    mantissa, exponent = math.frexp(largest)
    scale = mantissa * 256 / largest
    return bytes(int(c * scale) for c in color) + bytes([exponent + 128])


def packed(values):
    """Run-length codes of one channel of one row: runs above 128, literal bytes below."""
    out, at = bytearray(), 0
    while at < len(values):
        run = 1
        while at + run < len(values) and run < 127 and values[at + run] == values[at]:
            run += 1
        if run > 2:
            out += bytes([128 + run, values[at]])
            at += run
            continue
        end = at
        while end < len(values) and end - at < 128 and not (values[end : end + 3].count(values[end]) == 3):
            end += 1
        out += bytes([end - at]) + values[at:end]
        at = end
    return out


def main():
    data = bytearray(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (HEIGHT, WIDTH))
    for y in range(HEIGHT):
        elevation = (0.5 - (y + 0.5) / HEIGHT) * math.pi
        row = [rgbe(radiance(((x + 0.5) / WIDTH - 0.5) * 2 * math.pi, elevation)) for x in range(WIDTH)]
        data += bytes([2, 2, WIDTH >> 8, WIDTH & 255])
        for channel in range(4):
            data += packed(bytes(texel[channel] for texel in row))
    asset = pathlib.Path(__file__).parent.parent / "assets" / "sky.hdr"
    (asset if NAME == "afternoon" else pathlib.Path(sys.argv[2])).write_bytes(data)


main()
