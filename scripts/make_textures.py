#!/usr/bin/env python3
"""Makes the textures of assets/ and the die's mesh, the same pixels on every run and machine. The bytes of
compressed pixels may differ between versions of zlib.

    scripts/make_textures.py [FOLDER]

Only Python's standard library; noise is hashed from integers and needs no generator.
"""

import math
import os
import struct
import sys
import zlib

# Digits of 5 x 7 dots. Each number is a row; the leftmost dot is the highest bit.
DIGITS = [
    (14, 17, 19, 21, 25, 17, 14),
    (4, 12, 4, 4, 4, 4, 14),
    (14, 17, 1, 2, 4, 8, 31),
    (31, 2, 4, 2, 1, 17, 14),
    (2, 6, 10, 18, 31, 2, 2),
    (31, 16, 30, 1, 1, 17, 14),
    (6, 8, 16, 30, 17, 17, 14),
    (31, 1, 2, 4, 8, 8, 8),
    (14, 17, 17, 14, 17, 17, 14),
    (14, 17, 17, 15, 1, 2, 12),
]


def write_png(path, width, height, rows, palette=None):
    """Writes an 8-bit PNG from RGB rows, or from rows of indices into a palette of (r, g, b)."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 3 if palette else 2, 0, 0, 0)
    out = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"sRGB", b"\0")
    if palette:
        out += chunk(b"PLTE", b"".join(bytes(color) for color in palette))
    out += chunk(b"IDAT", zlib.compress(b"".join(b"\0" + bytes(row) for row in rows), 9))
    with open(path, "wb") as file:
        file.write(out + chunk(b"IEND", b""))


def hashed(x, y, z):
    """Hashes three integers to a number in [0, 1)."""
    n = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & 0xFFFFFFFF
    n = ((n ^ n >> 15) * 0x2C1B3C6D) & 0xFFFFFFFF
    n = ((n ^ n >> 12) * 0x297A2D39) & 0xFFFFFFFF
    return (n ^ n >> 15) / 4294967296.0


def noise(x, y, z):
    """Smooth noise in [0, 1) with one bump per unit."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = x - i, y - j, z - k
    u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
    total = 0.0
    for a, p in ((0, 1 - u), (1, u)):
        for b, q in ((0, 1 - v), (1, v)):
            for c, r in ((0, 1 - w), (1, w)):
                total += p * q * r * hashed(i + a, j + b, k + c)
    return total


def fractal(x, y, z, octaves):
    """Noise over several scales, about [0, 1)."""
    total, weight = 0.0, 0.5
    for octave in range(octaves):
        total += weight * noise(x, y, z + 17.0 * octave)
        x, y, z, weight = 2 * x, 2 * y, 2 * z, weight / 2
    return total / (1 - 2 * weight)


def mix(a, b, t):
    return tuple(round(p + (q - p) * t) for p, q in zip(a, b))


def number_dots(number, cell, dot):
    """The set dots (x, y) of a number, centred in a square cell."""
    text = [int(digit) for digit in str(number)]
    left = (cell - dot * (6 * len(text) - 1)) // 2
    top = (cell - dot * 7) // 2
    dots = set()
    for place, digit in enumerate(text):
        for row in range(7):
            for column in range(5):
                if DIGITS[digit][row] >> (4 - column) & 1:
                    x, y = left + dot * (6 * place + column), top + dot * row
                    dots.update((x + i, y + j) for i in range(dot) for j in range(dot))
    return dots


def hue(turn, value, saturation):
    """HSV to RGB bytes."""
    channels = []
    for shift in (5, 3, 1):
        k = (shift + turn * 6) % 6
        channels.append(round(255 * (value - value * saturation * max(0, min(k, 4 - k, 1)))))
    return tuple(channels)


def grid(path, size=1024, cells=8):
    """Numbered cells, 1 at the top left, hue by column, brightness by row."""
    cell = size // cells
    rows = []
    numbers = [number_dots(n + 1, cell, 9) for n in range(cells * cells)]
    for y in range(size):
        row = bytearray()
        for x in range(size):
            column, line = x // cell, y // cell
            i, j = x % cell, y % cell
            dark = (column + line) % 2
            color = hue(column / cells, 1.0 - 0.055 * line, 0.62 if dark else 0.38)
            if i < 3 or j < 3 or i >= cell - 3 or j >= cell - 3:
                color = (245, 245, 245)
            elif (i, j) in numbers[line * cells + column]:
                color = (24, 24, 32)
            row += bytes(color)
        rows.append(row)
    write_png(path, size, size, rows)


def checker(path, size=128, cells=8):
    """An ASCII PPM, as the coursework read them."""
    lines = ["P3", "# black and white squares", f"{size} {size}", "255"]
    for y in range(size):
        squares = ((x * cells // size + y * cells // size) % 2 for x in range(size))
        lines.append(" ".join("32 36 48" if dark else "235 232 225" for dark in squares))
    with open(path, "w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(lines) + "\n")


def pips(number):
    """Centres of the pips of one face, in [0, 1]^2."""
    near, middle, far = 0.25, 0.5, 0.75
    spots = {(middle, middle)} if number % 2 else set()
    if number > 1:
        spots |= {(near, near), (far, far)}
    if number > 3:
        spots |= {(near, far), (far, near)}
    if number == 6:
        spots |= {(near, middle), (far, middle)}
    return spots


def dice(path, cell=256):
    """Faces 1 2 3 over 4 5 6."""
    rows = []
    for y in range(2 * cell):
        row = bytearray()
        for x in range(3 * cell):
            number = x // cell + 1 + 3 * (y // cell)
            u, v = (x % cell + 0.5) / cell, (y % cell + 0.5) / cell
            distance = min(math.hypot(u - a, v - b) for a, b in pips(number))
            radius = 0.13 if number == 1 else 0.085
            cover = max(0.0, min(1.0, (radius - distance) * cell + 0.5))
            edge = min(u, v, 1 - u, 1 - v)
            face = mix((206, 194, 170), (248, 243, 230), min(1.0, edge / 0.05))
            row += bytes(mix(face, (178, 24, 30) if number in (1, 4) else (28, 28, 34), cover))
        rows.append(row)
    write_png(path, 3 * cell, 2 * cell, rows)


def dice_mesh(path):
    """A cube of edge 1, six quads, a `texcoord` list per face; opposite faces sum to 7."""
    corners = [(x, y, z) for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]
    faces = [
        (1, (2, 6, 7, 3)),  # +y
        (2, (4, 5, 7, 6)),  # +z
        (3, (5, 1, 3, 7)),  # +x
        (4, (0, 4, 6, 2)),  # -x
        (5, (1, 0, 2, 3)),  # -z
        (6, (0, 1, 5, 4)),  # -y
    ]
    lines = ["ply", "format ascii 1.0", "comment a die; texture dice.png", "element vertex 8"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += ["element face 6", "property list uchar int vertex_indices"]
    lines += ["property list uchar float texcoord", "end_header"]
    lines += [" ".join(f"{value:g}" for value in corner) for corner in corners]
    for number, quad in faces:
        left, bottom = (number - 1) % 3, 1 - (number - 1) // 3
        uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
        uv = " ".join(f"{(left + u) / 3:.7g} {(bottom + v) / 2:.7g}" for u, v in uv)
        lines.append(f"4 {' '.join(map(str, quad))} 8 {uv}")
    with open(path, "w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(lines) + "\n")


def planet(path, width=852, height=426):
    """Seas, land and ice for the sphere's (u, v): seamless, with the poles in the top and bottom row."""
    sea = [mix((8, 28, 78), (64, 158, 196), (i / 31) ** 2) for i in range(32)]
    land = []
    for high in range(8):
        for dry in range(8):
            low = mix((38, 104, 44), (206, 178, 112), dry / 7)
            land.append(mix(low, (122, 96, 72), high / 7))
    ice = [mix((196, 214, 226), (252, 253, 255), i / 7) for i in range(8)]
    rows = []
    for y in range(height):
        latitude = math.pi * (0.5 - (y + 0.5) / height)
        row = bytearray()
        for x in range(width):
            turn = 2 * math.pi * ((x + 0.5) / width - 0.5) + 0.94
            p = (math.cos(latitude) * math.sin(turn), -math.cos(latitude) * math.cos(turn), math.sin(latitude))
            ground = fractal(1.7 * p[0] + 5, 1.7 * p[1] + 3, 1.7 * p[2] + 7, 6)
            cold = abs(latitude) + 0.6 * (fractal(4 * p[0], 4 * p[1], 4 * p[2], 5) - 0.5)
            above = (ground - 0.52) / 0.22
            if cold > 1.22:
                row.append(96 + int(min(7.99, 40 * (cold - 1.22))))
            elif above < 0:
                row.append(int(31.99 * max(0.0, 1 + 2.2 * above)))
            else:
                dry = 1.2 - abs(abs(latitude) - 0.45) * 2 + (noise(4 * p[0], 4 * p[1], 4 * p[2]) - 0.5) * 1.4
                high = min(7, int(8 * above))
                row.append(32 + 8 * high + max(0, min(7, int(8 * dry))))
        rows.append(row)
    write_png(path, width, height, rows, sea + land + ice)


def wood(path, size=768, planks=6):
    """Planks along u with grain. Repeats in both directions, except for a seam of the grain at a joint."""
    shades = [mix((58, 32, 18), (196, 140, 88), i / 63) for i in range(64)]
    rows = []
    for y in range(size):
        plank, across = divmod(y * planks / size, 1)
        plank = int(plank)
        tone = 0.34 + 0.26 * hashed(plank, 3, 9)
        joint = int(size * hashed(plank, 5, 1))
        row = bytearray()
        for x in range(size):
            along = (x - joint) % size / size
            wave = noise(along * 5, across * 2.5 + 31 * plank, 0.5)
            rings = math.sin(26 * (across + 1.1 * wave) + 5 * hashed(plank, 1, 1))
            fibre = noise(along * 14, y * 0.55, 3.5 + plank)
            value = tone + 0.11 * rings + 0.26 * (fibre - 0.5) + 0.16 * (wave - 0.5)
            edge = min(across * size / planks, (1 - across) * size / planks, along * size, (1 - along) * size)
            value *= min(1.0, 0.35 + 0.3 * edge)
            row.append(max(0, min(63, int(64 * value))))
        rows.append(row)
    write_png(path, size, size, rows, shades)


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.join(os.path.dirname(__file__), "..", "assets")
    os.makedirs(folder, exist_ok=True)
    makers = [
        ("grid.png", grid),
        ("checker.ppm", checker),
        ("dice.png", dice),
        ("dice.ply", dice_mesh),
        ("planet.png", planet),
        ("wood.png", wood),
    ]
    for name, make in makers:
        path = os.path.join(folder, name)
        make(path)
        print(f"{path}: {os.path.getsize(path)} bytes")


if __name__ == "__main__":
    main()
