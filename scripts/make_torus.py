#!/usr/bin/env python3
"""Write a closed mesh of any size: a torus with bumps, as a binary PLY.

usage: make_torus.py TRIANGLES OUT.ply

Rows are written one by one, so memory does not grow with the mesh. A file has 19 bytes per
triangle. Needs numpy; about 0.1 s per million triangles.
"""
import sys

import numpy as np

RADIUS, TUBE = 1.0, 0.45
OCTAVES = 7


def bumps(u, v):
    """Height above the tube. Angles in radians; the frequencies are whole, so the torus closes."""
    height = np.zeros_like(v)
    for octave in range(OCTAVES):
        f = 5 * 2**octave
        height += np.sin(f * u + 1.3 * octave) * np.sin(f * v + 2.1 * octave) / 2**octave
    return 0.03 * height


def vertices(i, rows, columns):
    """Row `i` of the vertices, around the tube."""
    u = 2 * np.pi * i / rows
    v = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    tube = TUBE + bumps(u, v)
    ring = RADIUS + tube * np.cos(v)
    return np.stack([ring * np.cos(u), tube * np.sin(v), ring * np.sin(u)], 1).astype("<f4")


def faces(i, rows, columns):
    """The triangles between row `i` and the next, two for each cell."""
    here = i * columns + np.arange(columns)
    there = (i + 1) % rows * columns + np.arange(columns)
    a, b, c, d = here, np.roll(here, -1), there, np.roll(there, -1)
    row = np.empty((columns, 2), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    row["n"] = 3
    row["v"] = np.stack([np.stack([a, b, c], 1), np.stack([d, c, b], 1)], 1)
    return row


def main():
    if len(sys.argv) != 3 or not sys.argv[1].isdigit():
        sys.exit(__doc__)
    # The ring is about 2.2 times as long as the tube is around.
    columns = max(3, round((int(sys.argv[1]) / 2 / 2.2) ** 0.5))
    rows = max(3, -(-int(sys.argv[1]) // (2 * columns)))
    with open(sys.argv[2], "wb") as out:
        header = "ply\nformat binary_little_endian 1.0\n"
        header += f"element vertex {rows * columns}\n"
        header += "".join(f"property float {axis}\n" for axis in "xyz")
        header += f"element face {2 * rows * columns}\nproperty list uchar int vertex_indices\n"
        out.write((header + "end_header\n").encode())
        for i in range(rows):
            out.write(vertices(i, rows, columns).tobytes())
        for i in range(rows):
            out.write(faces(i, rows, columns).tobytes())
    print(f"{sys.argv[2]}: {rows * columns} vertices, {2 * rows * columns} triangles")


if __name__ == "__main__":
    main()
