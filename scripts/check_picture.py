#!/usr/bin/env python3
"""Checks PREFIX.exr and PREFIX.png without any code of lightpath. OpenEXR's exrmaketiled decodes the EXR,
Python's zlib the PNG. Both must show the same picture, with at least 256 colours.

    scripts/check_picture.py PREFIX
"""

import array
import math
import os
import struct
import subprocess
import sys
import tempfile
import zlib


class Wrong(Exception):
    pass


def read_exr(path):
    """Returns (width, height, {channel: floats from top left}) of a flat single-part EXR."""
    with tempfile.TemporaryDirectory() as folder:
        tiled = os.path.join(folder, "tiled.exr")
        subprocess.run(["exrmaketiled", "-o", "-z", "none", "-t", "64", "64", path, tiled], check=True)
        with open(tiled, "rb") as file:
            data = file.read()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or not version & 0x200 or version & 0x1800:
        raise Wrong(f"{path}: not a flat single-part OpenEXR file")
    at, header = 8, {}
    while data[at]:
        end = data.index(0, at)
        name, at = data[at:end].decode(), end + 1
        at = data.index(0, at) + 1
        (size,) = struct.unpack_from("<I", data, at)
        header[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    at += 1
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels, rest = [], header["channels"]
    while rest[0]:
        end = rest.index(0)
        channels.append((rest[:end].decode(), struct.unpack_from("<I", rest, end + 1)[0]))
        rest = rest[end + 17 :]
    pixels = {name: array.array("f", bytes(4 * width * height)) for name, _ in channels}
    tile_width, tile_height = struct.unpack_from("<II", header["tiles"])
    count = -(-width // tile_width) * -(-height // tile_height)
    for offset in struct.unpack_from(f"<{count}Q", data, at):
        column, row = struct.unpack_from("<2i", data, offset)
        left, top, at = column * tile_width, row * tile_height, offset + 20
        across = min(tile_width, width - left)
        for y in range(top, min(top + tile_height, height)):
            for name, kind in channels:
                form, size = {0: ("I", 4), 1: ("e", 2), 2: ("f", 4)}[kind]
                values = struct.unpack_from(f"<{across}{form}", data, at)
                pixels[name][y * width + left : y * width + left + across] = array.array("f", values)
                at += size * across
    return width, height, pixels


def read_png(path):
    """Returns (width, height, bytes per pixel, rows, names of the chunks) of an 8-bit RGB or RGBA PNG."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise Wrong(f"{path}: not a PNG file")
    at, chunks = 8, []
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        if zlib.crc32(name + body) != struct.unpack_from(">I", data, at + 8 + size)[0]:
            raise Wrong(f"{path}: wrong checksum in its {name.decode()} chunk")
        chunks.append((name, body))
        at += 12 + size
    width, height, depth, kind, _, _, interlace = struct.unpack(">IIBBBBB", chunks[0][1])
    if depth != 8 or kind not in (2, 6) or interlace:
        raise Wrong(f"{path}: depth {depth}, colour type {kind}, interlace {interlace}")
    step = 3 if kind == 2 else 4
    raw = zlib.decompress(b"".join(body for name, body in chunks if name == b"IDAT"))
    rows, above = [], bytes(width * step)
    for y in range(height):
        start = y * (width * step + 1)
        row = bytearray(raw[start + 1 : start + 1 + width * step])
        unfilter(raw[start], row, above, step)
        rows.append(row)
        above = row
    return width, height, step, rows, [name for name, _ in chunks]


def unfilter(kind, row, above, step):
    for x in range(len(row) if kind else 0):
        left = row[x - step] if x >= step else 0
        corner = above[x - step] if x >= step else 0
        if kind == 4:
            guess = left + above[x] - corner
            row[x] = (row[x] + min((left, above[x], corner), key=lambda v: abs(guess - v))) & 255
        else:
            row[x] = (row[x] + (left, above[x], (left + above[x]) // 2)[kind - 1]) & 255


def check(prefix):
    width, height, pixels = read_exr(prefix + ".exr")
    if not {"R", "G", "B", "A"} <= pixels.keys():
        raise Wrong(f"{prefix}.exr has the channels {sorted(pixels)}, not R G B A")
    for name in "RGBA":
        bad = [value for value in pixels[name] if not math.isfinite(value) or value < 0]
        if bad:
            raise Wrong(f"{prefix}.exr: {len(bad)} pixels of {name} are negative or not finite, e.g. {bad[0]}")
    if max(pixels["A"]) > 1:
        raise Wrong(f"{prefix}.exr: alpha goes up to {max(pixels['A'])}")

    png_width, png_height, step, rows, chunks = read_png(prefix + ".png")
    if (png_width, png_height) != (width, height):
        raise Wrong(f"{prefix}: the EXR is {width}x{height}, the PNG {png_width}x{png_height}")
    if b"sRGB" not in chunks:
        raise Wrong(f"{prefix}.png has no sRGB chunk")
    colours = len({bytes(row[x : x + 3]) for row in rows for x in range(0, len(row), step)})
    if colours < 256:
        raise Wrong(f"{prefix}.png has only {colours} colours: that is no rendered still life")

    # Tone mapping is an increasing curve per channel, so the values of two pixels have the same order
    # in the EXR and in the PNG.
    ups = downs = 0
    for place in range(0, width * height - 997, 997):
        for channel, name in enumerate("RGB"):
            a, b = pixels[name][place], pixels[name][place + 997]
            c, d = (rows[p // width][p % width * step + channel] for p in (place, place + 997))
            if a > 1.05 * b + 1e-3 or b > 1.05 * a + 1e-3:
                ups, downs = ups + ((a > b) == (c > d) or c == d), downs + ((a > b) != (c > d) and c != d)
    if downs > 0.02 * (ups + downs):
        raise Wrong(f"{prefix}: the PNG is not the EXR's picture: {downs} of {ups + downs} pairs differ in order")
    print(f"{prefix}: {width}x{height}, EXR channels {' '.join(sorted(pixels))}, PNG {colours} colours: right")


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        check(sys.argv[1])
    except (Wrong, OSError, ValueError, KeyError, IndexError, struct.error, zlib.error, subprocess.CalledProcessError) as error:
        sys.exit(f"check_picture: {error}")


main()
