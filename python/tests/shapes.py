"""Meshes with integer vertices, and an oracle in integers."""

import numpy as np

TETRAHEDRON = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64),
    np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int64),
)

# A PLY file.
TRIANGLE = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)


def cube(half=1):
    """A cube from -half to half in 12 triangles, with outward normals."""
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)]) * half
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners.astype(np.float64), np.array(faces, dtype=np.int64)


def bumpy_sphere(levels=2, radius=4096, seed=1):
    """A closed sphere with integer vertices, as float64, and thin, steep and folded faces."""
    vertices, faces = cube()
    for _ in range(levels):
        middles, new_vertices, new_faces = {}, list(vertices), []

        def middle(a, b):
            key = min(a, b), max(a, b)
            if key not in middles:
                middles[key] = len(new_vertices)
                new_vertices.append((vertices[a] + vertices[b]) / 2)
            return middles[key]

        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            new_faces += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        vertices, faces = np.array(new_vertices), np.array(new_faces)
    vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    factor = np.random.default_rng(seed).uniform(0.5, 1.0, len(vertices))[:, None]
    return np.round(vertices * factor * radius), faces.astype(np.int64)


def _determinant(a, b, c):
    return (
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        - a[..., 1] * (b[..., 0] * c[..., 2] - b[..., 2] * c[..., 0])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    )


def oracle_contains(vertices, faces, points):
    """Whether integer points are in or on a closed mesh of integer vertices. Nothing rounds.

    Crossings of a half-line are counted. Where it meets an edge, another direction is taken.
    Magnitudes must stay below 2**15.
    """
    triangles = vertices.astype(np.int64)[faces]
    answers = []
    for point in np.asarray(points).astype(np.int64):
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        volume = _determinant(a, b, c)
        if _is_on(a, b, c, volume):
            answers.append(True)
            continue
        for direction in ([101, 211, 1009], [997, 103, 53], [-11, 1013, 401], [3, -7, 997]):
            d = np.broadcast_to(np.array(direction), a.shape)
            sides = np.stack([_determinant(d, b, c), _determinant(d, c, a), _determinant(d, a, b)])
            inside = (sides > 0).all(axis=0) | (sides < 0).all(axis=0)
            edge = (sides == 0).any(axis=0) & ((sides >= 0).all(0) | (sides <= 0).all(0))
            if not edge.any():
                towards = sides.sum(axis=0)
                crossed = inside & (np.sign(volume) == np.sign(towards))
                answers.append(bool(crossed.sum() % 2))
                break
        else:
            raise AssertionError("every direction meets an edge")
    return np.array(answers)


def _is_on(a, b, c, volume):
    """Whether the origin lies on one of the triangles."""
    inside = volume == 0
    for axis in range(3):
        x, y = (axis + 1) % 3, (axis + 2) % 3
        sides = np.stack([p[:, x] * q[:, y] - p[:, y] * q[:, x] for p, q in ((a, b), (b, c), (c, a))])
        inside &= (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
    corners = np.stack([a, b, c])
    inside &= ((corners.min(0) <= 0) & (corners.max(0) >= 0)).all(axis=1)
    return inside.any()
