#!/usr/bin/env python3
"""Writes assets/ball.ply, an icosphere of 80 faces, and assets/ball-inward.ply, the same with normals
that point inward and every other face reversed."""

import math
from pathlib import Path


def normalized(p):
    length = math.sqrt(sum(x * x for x in p))
    return tuple(x / length for x in p)


def icosahedron():
    """Returns corners at distance 1 and faces that are counter-clockwise as seen from outside."""
    g = (1 + math.sqrt(5)) / 2
    points = []
    for a, b in ((1, g), (-1, g), (1, -g), (-1, -g)):
        points += [(0, a, b), (a, b, 0), (b, 0, a)]
    near = [[abs(math.dist(p, q) - 2) < 1e-9 for q in points] for p in points]
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(i + 1, 12):
                p, q, r = points[i], points[j], points[k]
                outward = (p[0] * (q[1] * r[2] - q[2] * r[1]) + p[1] * (q[2] * r[0] - q[0] * r[2])
                           + p[2] * (q[0] * r[1] - q[1] * r[0])) > 0
                if near[i][j] and near[j][k] and near[k][i] and outward:
                    faces.append((i, j, k))
    return [normalized(p) for p in points], faces


def split(points, faces):
    """Splits each face into four, with the new corners on the sphere."""
    middles = {}

    def middle(a, b):
        key = (min(a, b), max(a, b))
        if key not in middles:
            points.append(normalized(tuple(x + y for x, y in zip(points[a], points[b]))))
            middles[key] = len(points) - 1
        return middles[key]

    result = []
    for a, b, c in faces:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        result += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return result


def write(name, comment, rows, faces, normals):
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals else [])
    header = ["ply", "format ascii 1.0", f"comment {comment}", f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    body = [" ".join(f"{x:.7g}" for x in row) for row in rows]
    body += [f"3 {a} {b} {c}" for a, b, c in faces]
    path = Path(__file__).parent.parent / "assets" / name
    path.write_text("\n".join(header + body) + "\n")


points, faces = icosahedron()
faces = split(points, faces)
write("ball.ply", "icosphere of 80 faces, no normals", points, faces, False)
inward = [p + tuple(-x for x in p) for p in points]
turned = [(a, b, c) if k % 2 else (a, c, b) for k, (a, b, c) in enumerate(faces)]
write("ball-inward.ply", "80 faces, normals inward, every other face turned", inward, turned, True)
