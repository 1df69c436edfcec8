"""t, barycentrics and limits of hits name the same point, whatever the ray is."""

import numpy as np
import pytest

import lightpath
from shapes import TETRAHEDRON, cube


def rotation(rng):
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def gaps(triangles, origins, directions, t, barycentrics):
    """How far t lies beyond the corners along the ray, and from the point of the weights."""
    lengths = np.linalg.norm(directions, axis=1)
    along = np.einsum("ijk,ik->ij", triangles - origins[:, None], directions) / lengths[:, None]
    beyond = np.maximum(along.min(axis=1) - t * lengths, t * lengths - along.max(axis=1))
    u, v = barycentrics[:, :1], barycentrics[:, 1:]
    points = triangles[:, 0] * (1 - u - v) + triangles[:, 1] * u + triangles[:, 2] * v
    return beyond, np.abs(origins + t[:, None] * directions - points).max(axis=1)


@pytest.mark.parametrize("slope", [0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-3])
def test_rays_almost_in_the_plane_of_a_face_hit_within_the_face(slope):
    rng, (vertices, faces) = np.random.default_rng(1), cube()
    met = 0
    for _ in range(10):
        turned = rotation(rng)
        corners = vertices @ turned.T
        scene = lightpath.RayScene(corners, faces)
        start, end = rng.uniform(-0.9, 0.9, (2, 2000, 3))
        start[:, 2] = end[:, 2] = 1
        directions = end - start
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        directions[:, 2] = -slope
        origins, directions = (start - 5 * directions) @ turned.T, directions @ turned.T
        hits, every = scene.closest(origins, directions), scene.all_hits(origins, directions)
        hit, row = hits.primitive >= 0, np.repeat(np.arange(2000), np.diff(every.offsets))
        met += hit.sum()
        for ids, index, t, barycentrics in [
            (hits.primitive[hit], hit, hits.t[hit], hits.barycentrics[hit]),
            (every.primitive, row, every.t, every.barycentrics),
        ]:
            rays = origins[index], directions[index]
            beyond, apart = gaps(corners[faces[ids]], *rays, t, barycentrics)
            assert beyond.max() < 1e-4 and apart.max() < 1e-4, (beyond.max(), apart.max())
    assert met > 1000


def test_a_ray_in_the_plane_of_a_small_mesh_of_doubles():
    corners = np.array([[-1.3, 1.4, -1], [1.3, -2, -1.8], [-1.8, 1.7, 1.3]])
    scene = lightpath.RayScene(corners, [[0, 1, 2]])
    ray = np.array([[-6.75, 8.35, 1.75]]), np.array([[2.6, -3.4, -0.8]])
    for hits in (scene.closest(*ray), scene.all_hits(*ray)):
        beyond, apart = gaps(corners[None], *ray, hits.t, hits.barycentrics)
        assert beyond.max() < 1e-6 and apart.max() < 1e-6


# Similar rays are traced together, a ray alone by other code.
@pytest.mark.parametrize("corners, origin, direction", [
    ([[-1.7, 0.8, -1.9], [-1.6, 1.1, -0.8], [1.9, 0.3, 1.2]], [2.2, 1.2, 4.5], [-2.42, -0.48, -4.72]),
    ([[1.3, 1.2, 1.6], [1, -1.5, 1.4], [-0.5, 1, -1.2]], [-0.8, -1.7, -1.4], [0.96, 2.24, 1.28]),
])
def test_equal_rays_in_the_plane_of_a_face_have_the_hit_of_one(corners, origin, direction):
    scene = lightpath.RayScene(corners, [[0, 1, 2]])
    alone, rays = scene.closest([origin], [direction]), ([origin] * 16, [direction] * 16)
    hits = scene.closest(*rays)
    assert np.allclose(hits.t, alone.t, rtol=1e-5)
    assert np.allclose(hits.barycentrics, alone.barycentrics, atol=1e-5)
    assert (scene.closest(*rays, tnear=hits.t).primitive == -1).all()


@pytest.mark.parametrize("length", [5e-324, 1e-310, 1e-308])
def test_short_directions_from_far_away(length):
    scene = lightpath.RayScene(*TETRAHEDRON)
    ray = [0.25, 0.25, 50], [0, 0, -length]
    assert scene.closest(*ray).t == np.finfo(float).max and scene.closest(*ray).primitive == 3
    assert scene.occluded(*ray) and scene.count(*ray) == 2


@pytest.mark.parametrize("length", [5e-324, 1e-310, 1e-300, 1e300, 1e303, 1e308])
def test_directions_of_extreme_length(length):
    scene = lightpath.RayScene(TETRAHEDRON[0] * 1000, TETRAHEDRON[1])
    ray = [100, 200, 1700.0], [0, 0, -length]
    for hits in (scene.closest(*ray), scene.all_hits(*ray)):
        # The largest double stands for a t beyond it.
        with np.errstate(over="ignore"):
            expected = min(1000 / np.float64(length), np.finfo(float).max)
        hit = hits.primitive.tolist().index(3)
        assert np.isclose(hits.t[hit], expected, rtol=1e-14)
        assert np.allclose(hits.barycentrics[hit], [0.2, 0.7], rtol=1e-14)


def box_rays(count, seed=3):
    """A box at no simple place, and rays at and beside it."""
    vertices, faces = cube()
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * 5
    return vertices + [0.1, 0.2, 0.3], faces, origins, rng.normal(size=(count, 3)) * 0.3 - origins


def test_the_next_layer_of_hits_and_misses():
    scene = lightpath.RayScene(*TETRAHEDRON)
    rays = [[0.25, 0.25, 5], [3, 3, 3], [0.1, 0.1, 5]], [0, 0, -1]
    hits = scene.closest(*rays)
    assert np.isinf(hits.t).tolist() == [False, True, False]
    layer = scene.closest(*rays, tnear=hits.t)
    assert np.allclose(layer.t, [5, np.inf, 5]) and layer.primitive.tolist() == [0, -1, 0]
    assert scene.occluded(*rays, tnear=hits.t).tolist() == [True, False, True]
    assert scene.count(*rays, tnear=hits.t).tolist() == [1, 0, 1]
    assert np.diff(scene.all_hits(*rays, tnear=hits.t).offsets).tolist() == [1, 0, 1]
    assert scene.closest(*rays, tnear=np.inf).primitive.tolist() == [-1] * 3


@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e6])
def test_closest_behind_each_hit_peels_all_layers(scale):
    vertices, faces, origins, directions = box_rays(10_000)
    scene = lightpath.RayScene(vertices * scale, faces)
    origins = origins * scale
    every = scene.all_hits(origins, directions)
    t, left = np.zeros(len(origins)), np.arange(len(origins))
    for layer in range(4):
        hits = scene.closest(origins[left], directions[left], tnear=t[left])
        hit = hits.primitive >= 0
        assert (hits.t > t[left])[hit].all()
        assert (scene.occluded(origins[left], directions[left], t[left]) == hit).all()
        assert (scene.count(origins[left], directions[left], t[left]) >= hit).all()
        assert (hit == (np.diff(every.offsets)[left] > layer)).all()
        t[left], left = hits.t, left[hit]
        assert (t[left] == every.t[every.offsets[left] + layer]).all()
    assert len(left) == 0


def test_tfar_excludes_the_hit_at_its_end_and_no_other():
    vertices, faces, origins, directions = box_rays(10_000)
    scene = lightpath.RayScene(vertices, faces)
    hits = scene.closest(origins, directions)
    hit = hits.primitive >= 0
    rays, t = (origins[hit], directions[hit]), hits.t[hit]
    for tfar, met in [(t, False), (np.nextafter(t, 0), False), (np.nextafter(t, np.inf), True)]:
        for tnear in (0.0, t * (1 - 1e-15)):
            assert ((scene.closest(*rays, tnear, tfar).primitive >= 0) == met).all()
            assert (scene.occluded(*rays, tnear, tfar) == met).all()
            assert (scene.count(*rays, tnear, tfar) == met).all()
            assert len(scene.all_hits(*rays, tnear, tfar).t) == met * len(t)


def test_limits_of_each_ray_and_of_none():
    vertices, faces, origins, directions = box_rays(1000)
    scene = lightpath.RayScene(vertices, faces)
    every, tnear = scene.all_hits(origins, directions), np.zeros(1000)
    first = every.t[every.offsets[:-1][np.diff(every.offsets) > 0]]
    tnear[np.diff(every.offsets) > 0] = np.where(np.arange(len(first)) % 3 == 0, first, 0)
    hits = scene.all_hits(origins, directions, tnear)
    row = np.repeat(np.arange(1000), np.diff(hits.offsets))
    assert ((hits.t > tnear[row]) & (len(hits.t) < len(every.t))).all()
    assert (np.diff(hits.offsets) == scene.count(origins, directions, tnear)).all()


def test_a_file_keeps_the_faces_that_close_t_junctions(tmp_path):
    """One side of a box uses points on an edge that the other side does not use."""
    vertices, faces = cube()
    between = np.float32(np.linspace(-1, 1, 11)[1:-1] ** 3)
    points = [[x, 1, 1] for x in between.astype(float)]
    chain = [6, *range(8, 8 + len(points)), 7]
    assert vertices[6].tolist() == [-1, 1, 1] and vertices[7].tolist() == [1, 1, 1]
    # The side y = 1, without its two triangles, as a fan.
    faces = [face for face in faces.tolist() if not (vertices[face][:, 1] == 1).all()]
    faces += [[2, a, b] for a, b in zip(chain, chain[1:])] + [[2, 7, 3]]
    stitches = [[6, b, a] for a, b in zip(chain[1:], chain[2:])]
    vertices = np.concatenate([vertices, points]) * [1, 1.1, 0.9]
    lines = [" ".join(map(repr, v)) for v in vertices.tolist()]
    lines += ["3 " + " ".join(map(str, face)) for face in stitches + faces]
    path = tmp_path / "box.ply"
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty double x\nproperty double y\n"
        f"property double z\nelement face {len(faces + stitches)}\nproperty list uchar int vertex_indices\n"
        "end_header\n" + "\n".join(lines) + "\n"
    )
    scene = lightpath.RayScene.from_ply(path)
    assert scene.is_closed == [True] and scene.meshes[0][1].tolist() == faces + stitches
    rng = np.random.default_rng(0)
    targets = np.stack([rng.uniform(-1, 1, 50_000), np.full(50_000, 1.1), np.full(50_000, 0.9)], axis=1)
    origins = rng.uniform(-0.8, 0.8, (50_000, 3))
    assert (scene.closest(origins, targets - origins).primitive >= 0).all()
    assert (scene.count(origins, targets - origins) % 2 == 1).all()
