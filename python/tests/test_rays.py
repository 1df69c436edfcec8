"""Answers of `RayScene`, against closed forms, integers and brute force."""

import copy
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import lightpath
from shapes import TETRAHEDRON, TRIANGLE, bumpy_sphere, cube, oracle_contains


def brute_force(vertices, faces, origins, directions):
    """All t of each ray, in f64 (Moeller and Trumbore). For rays in general position."""
    a, b, c = np.moveaxis(vertices[faces].astype(np.float64), 1, 0)
    e1, e2 = b - a, c - a
    everything = []
    for origin, direction in zip(origins, directions):
        p = np.cross(direction, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / (e1 * p).sum(1)
            s = origin - a
            u = (s * p).sum(1) * inverse
            q = np.cross(s, e1)
            v = (q * direction).sum(1) * inverse
            t = (e2 * q).sum(1) * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        index = np.nonzero(hit)[0]
        everything.append(sorted(zip(t[index], index, u[index], v[index])))
    return everything


@pytest.fixture(scope="module")
def sphere():
    vertices, faces = bumpy_sphere()
    return vertices, faces, lightpath.RayScene(vertices, faces)


def random_rays(count, radius, seed=0):
    """Rays of float32 values, so that nothing is rounded."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins *= 2 * radius / np.linalg.norm(origins, axis=1)[:, None]
    directions = rng.uniform(-radius, radius, (count, 3)) * 0.7 - origins
    return origins.astype(np.float32).astype(np.float64), directions.astype(np.float32).astype(float)


def test_closest_and_all_hits_are_those_of_brute_force(sphere):
    vertices, faces, scene = sphere
    origins, directions = random_rays(400, 4096)
    expected = brute_force(vertices, faces, origins, directions)
    hits, every = scene.closest(origins, directions), scene.all_hits(origins, directions)
    counts = scene.count(origins, directions)
    assert (counts == [len(hits) for hits in expected]).all() and counts.max() > 2
    assert (scene.occluded(origins, directions) == (counts > 0)).all()
    for i, wanted in enumerate(expected):
        own = slice(every.offsets[i], every.offsets[i + 1])
        assert every.primitive[own].tolist() == [hit[1] for hit in wanted]
        assert np.allclose(every.t[own], [hit[0] for hit in wanted], rtol=1e-12)
        assert np.allclose(every.barycentrics[own], np.reshape([hit[2:] for hit in wanted], (-1, 2)), atol=1e-9)
        if wanted:
            assert hits.primitive[i] == wanted[0][1] and np.isclose(hits.t[i], wanted[0][0], rtol=1e-12)
            point = (origins + hits.t[:, None] * directions)[i]
            u, v = hits.barycentrics[i]
            corners = vertices[faces[hits.primitive[i]]]
            assert np.allclose((1 - u - v) * corners[0] + u * corners[1] + v * corners[2], point)
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            assert np.allclose(hits.normal[i], normal / np.linalg.norm(normal))
        else:
            assert hits.t[i] == np.inf and hits.primitive[i] == -1 and hits.mesh[i] == -1
            assert np.isnan(hits.barycentrics[i]).all() and (hits.normal[i] == 0).all()


def test_a_ray_through_vertices_and_edges_counts_each_crossing_once(sphere):
    """Parity: from outside a closed mesh every count is even, from inside it is odd."""
    vertices, faces, scene = sphere
    edges = (vertices[faces] + vertices[np.roll(faces, 1, axis=1)]).reshape(-1, 3) / 2
    inside = np.array([0.0, 0.0, 0.0])
    assert oracle_contains(vertices, faces, [inside]).all()
    for targets in (vertices, edges, np.round(vertices[faces].mean(axis=1))):
        counts = scene.count(inside, targets - inside)
        assert (counts % 2 == 1).all()
        hits = scene.all_hits(inside, targets - inside)
        assert (np.diff(hits.offsets) == counts).all()
        starts = np.repeat(hits.offsets[:-1], counts)
        later = np.arange(len(hits.t)) > starts
        assert (np.diff(hits.t)[later[1:]] >= 0).all()
        for axis in range(3):
            for sign in (-1, 1):
                direction = np.zeros(3)
                direction[axis] = sign
                counts = scene.count(targets - direction * 3 * 4096, direction)
                assert (counts % 2 == 0).all()


def test_a_star_shaped_mesh_is_hit_once_through_every_vertex_and_edge():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces)
    lattice = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    directions = lattice[np.abs(lattice).max(axis=1) > 0]
    assert (scene.count([0, 0, 0], directions) == 1).all()
    assert (scene.all_hits([0, 0, 0], directions).t == 1.0).all()
    # From outside along an edge, in the plane of a face, or through a corner: 0 or 2.
    touching = scene.count([[-3, 1, 1], [-3, 0, 1], [-3, 1, 0], [-3, -1, -1]], [1, 0, 0])
    assert set(touching.tolist()) <= {0, 2}


def test_contains_is_exact_on_lattice_points(sphere):
    vertices, faces, scene = sphere
    rng = np.random.default_rng(3)
    points = rng.integers(-3000, 3000, (2000, 3))
    # Points in the planes and lines of vertices, and the vertices themselves.
    planes = rng.integers(-3000, 3000, (1000, 3))
    planes[:, 0] = vertices[rng.integers(len(vertices), size=1000), 0]
    lines = vertices[rng.integers(len(vertices), size=1000)].copy()
    lines[:, 2] += rng.integers(-900, 900, 1000)
    for some in (points, planes, lines, vertices):
        expected = oracle_contains(vertices, faces, some)
        assert (scene.contains(some) == expected).all()
    assert scene.contains(vertices).all()


@pytest.mark.parametrize("offset", [0.0, 2.0**20, 2.0**33])
def test_contains_is_exact_far_from_zero(offset):
    """Coordinates are exact in f64, but not in f32."""
    vertices, faces = bumpy_sphere(levels=1)
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.integers(-3000, 3000, (1000, 3)), vertices])
    expected = oracle_contains(vertices, faces, points)
    scene = lightpath.RayScene(vertices + offset, faces)
    assert (scene.contains(points + offset) == expected).all()


def test_points_beside_faces_edges_and_vertices_are_told_apart():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces)
    rng = np.random.default_rng(5)
    on = rng.uniform(-1, 1, (3000, 3))
    axis, side = rng.integers(3, size=3000), rng.choice([-1.0, 1.0], 3000)
    row = np.arange(3000)
    on[row, axis] = side
    on[::3] = np.where(rng.random((1000, 3)) < 0.5, on[::3], np.sign(on[::3]))
    on[row, axis] = side
    assert scene.contains(on).all()
    below, above = on.copy(), on.copy()
    below[row, axis] = np.nextafter(side, 0)
    above[row, axis] = np.nextafter(side, 2 * side)
    assert scene.contains(below).all() and not scene.contains(above).any()
    assert not scene.contains([[np.nextafter(1, 2), 1, 1], [-1, -1, np.nextafter(-1, -2)]]).any()


def test_an_open_mesh_uses_winding_numbers():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces[2:])
    assert scene.is_closed == [False] and lightpath.RayScene(vertices, faces).is_closed == [True]
    assert scene.contains([[0, 0, 0.5], [0, 0, -3], [5, 0, 0]]).tolist() == [True, False, False]
    whole = lightpath.RayScene(vertices, faces)
    assert np.allclose(whole.winding_number([[0, 0, 0.5], [0, 4, 0]]), [1, 0], atol=0.01)
    # Duplicated vertices do not open a mesh.
    soup = lightpath.RayScene(vertices[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert soup.is_closed == [True]


def test_open_meshes_count_together_and_may_be_inside_out():
    vertices, faces = cube()
    inside_out = lightpath.RayScene(vertices, faces[2:, ::-1])
    assert inside_out.contains([[0, 0, 0.5], [0, 0, -3]]).tolist() == [True, False]
    assert -1 < inside_out.winding_number([0, 0, 0.5])[0] < -0.5
    halves = lightpath.RayScene.from_meshes([(vertices, faces[:6]), (vertices, faces[6:])])
    assert halves.is_closed == [False, False]
    assert halves.contains([[0, 0, 0], [3, 0, 0]]).tolist() == [True, False]
    assert np.allclose(halves.winding_number([[0, 0, 0], [3, 0, 0]]), [1, 0], atol=0.02)
    # A solid that is there twice has nothing inside.
    twice = lightpath.RayScene(vertices, np.concatenate([faces, faces]))
    assert twice.is_closed == [True] and not twice.contains([0, 0, 0]).any()


def test_of_equally_near_faces_the_first_one_of_the_first_mesh_counts():
    vertices, faces = cube()
    scene = lightpath.RayScene.from_meshes([(vertices, faces), (vertices, faces)])
    hits = scene.closest([[0.1, 0.2, 5], [1, 1, 5]], [0, 0, -1])
    assert hits.mesh.tolist() == [0, 0] and hits.primitive.tolist() == [3, 2]
    nearest = scene.closest_point([[0, 0, 0], [5, 5, 5]])
    assert nearest.mesh.tolist() == [0, 0] and nearest.primitive.tolist() == [0, 2]


def test_several_meshes():
    vertices, faces = cube()
    both = lightpath.RayScene.from_meshes([(vertices, faces), (vertices.astype(np.float32) + 5, faces)])
    hits = both.closest([[0, 0, 9], [5, 5, 9], [9, 0, 9]], [0, 0, -1])
    assert hits.mesh.tolist() == [0, 1, -1] and (hits.primitive < 12).all()
    assert both.contains([[0, 0, 0], [5, 5, 5], [3, 3, 3]]).tolist() == [True, True, False]
    # Overlapping meshes: inside either.
    nested = lightpath.RayScene.from_meshes([(vertices, faces), (vertices * 3, faces)])
    assert nested.contains([[0, 0, 0], [2, 2, 2], [4, 0, 0]]).tolist() == [True, True, False]
    hits = nested.all_hits([0, 0.1, 9], [0, 0, -1])
    assert hits.mesh.tolist() == [1, 0, 0, 1] and hits.t.tolist() == [6, 8, 10, 12]


def test_distances_are_those_of_closed_forms():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces)
    points = np.random.default_rng(6).uniform(-4, 4, (5000, 3))
    outside = np.linalg.norm(np.maximum(np.abs(points) - 1, 0), axis=1)
    inside = 1 - np.abs(points).max(axis=1)
    expected = np.where(inside > 0, -inside, outside)
    assert np.allclose(scene.distance(points, signed=True), expected, atol=1e-14)
    assert np.allclose(scene.distance(points), np.abs(expected), atol=1e-14)
    nearest = scene.closest_point(points)
    assert np.allclose(np.linalg.norm(nearest.point - points, axis=1), nearest.distance)
    far = scene.closest_point([[1e6, 0.5, 0.25]])
    assert np.allclose(far.point, [[1, 0.5, 0.25]]) and far.distance[0] == 1e6 - 1


def test_visible_points_do_not_hide_themselves():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces)
    seen = scene.visible(vertices, [0.5, 0.25, 7])
    assert (seen == (vertices[:, 2] > 0)).all()
    # From inside all are seen, and through a wall none.
    assert scene.visible(vertices, [0.1, 0.2, 0.3]).all()
    assert not scene.visible(vertices * 1.5, [0.1, 0.2, 0.3]).any()
    assert scene.visible([[3, 3, 3], [3, 3, -3]], [[3, 3, -3], [-3, -3, 3]]).tolist() == [True, False]
    assert scene.visible([[3, 3, 3]], [3, 3, 3]).all()


def test_a_segment_is_open():
    scene = lightpath.RayScene(*TETRAHEDRON)
    ray = [0.25, 0.25, 2.5], [0, 0, -1]
    assert scene.occluded(*ray, 0, 2).tolist() == [False]
    assert scene.occluded(*ray, 0, [2.25]).tolist() == [True]
    assert scene.closest(*ray, 2.0).t.tolist() == [2.5]
    assert scene.count(*ray, 0, [0.0]).tolist() == [0]


def test_scales_of_directions_and_meshes():
    vertices, faces = TETRAHEDRON
    for scale in (1e-30, 1e-12, 1.0, 1e12):
        scene = lightpath.RayScene(vertices * scale, faces)
        for length in (1e-280, 1e-20, 1.0, 1e20, 1e280):
            hits = scene.closest([0.25 * scale, 0.25 * scale, 2 * scale], [0, 0, -length])
            assert np.isclose(hits.t[0] * length, 1.5 * scale, rtol=1e-6), (scale, length)
            assert hits.primitive[0] == 3


def test_rays_from_far_away_and_big_coordinates():
    vertices, faces = cube()
    middle = np.array([499_999.375, 4_100_000.625, 31.25])
    scene = lightpath.RayScene(vertices + middle, faces)
    x, y = np.meshgrid(np.linspace(-0.99, 0.99, 41), np.linspace(-0.99, 0.99, 41))
    for away in (2.0, 1e3, 1e7):
        origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, away)], axis=1) + middle
        hits = scene.closest(origins, [0, 0, -1])
        assert np.allclose(hits.t, away - 1, rtol=1e-9) and (hits.normal[:, 2] == 1).all()
        assert (scene.count(origins, [0, 0, -1]) == 2).all()


def test_one_ray_and_many_give_the_same_bits(sphere):
    _, _, scene = sphere
    origins, directions = random_rays(40_000, 4096, seed=7)
    all_at_once = scene.closest(origins, directions)
    for i in (0, 1, 17, 39_999):
        alone = scene.closest(origins[i], directions[i])
        for one, many in zip(alone, all_at_once):
            assert (one[0] == many[i]).all() or np.isnan(one[0]).all()
    one_thread = lightpath.RayScene(*scene.meshes[0], threads=1).closest(origins, directions)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one_thread, all_at_once))


def test_types_and_orders_of_arrays_make_no_difference(sphere):
    vertices, faces, scene = sphere
    origins, directions = random_rays(300, 4096, seed=8)
    expected = scene.closest(origins, directions)
    for dtype in (np.float32, np.float64, ">f4", ">f8"):
        for index in (np.uint32, np.int32, np.int64, np.uint64, ">i4", np.uint16):
            other = lightpath.RayScene(vertices.astype(dtype), faces.astype(index))
            assert (other.closest(origins, directions).t == expected.t).all(), (dtype, index)
    corners, sides = cube(2048)
    assert (corners == corners.astype(np.float16)).all()
    halves = lightpath.RayScene(corners.astype(np.float16), sides).closest(origins, directions)
    singles = lightpath.RayScene(corners, sides).closest(origins, directions)
    assert (halves.t == singles.t).all() and np.isfinite(singles.t).any()
    frozen = vertices.copy(), faces.copy()
    for array in frozen:
        array.flags.writeable = False
    spread = np.repeat(vertices, 2, axis=0)[::2], np.asfortranarray(faces)
    for arrays in (frozen, spread, (vertices.tolist(), faces.tolist())):
        other = lightpath.RayScene(*arrays)
        rays = np.asfortranarray(origins), directions[:, ::-1][:, ::-1]
        assert (other.closest(*rays).t == expected.t).all()
    rays = origins.copy()
    rays.flags.writeable = False
    assert (scene.closest(rays, directions).t == expected.t).all()


def test_arrays_in_c_order_are_not_copied():
    vertices, faces = (np.ascontiguousarray(array) for array in cube())
    scene = lightpath.RayScene(vertices, faces)
    assert scene.meshes[0][0] is vertices and scene.meshes[0][1] is faces


def test_arrays_that_change_do_no_harm():
    vertices, faces = cube()
    scene = lightpath.RayScene(vertices, faces)
    faces[:] = 2**40
    hits = scene.closest([0, 0, 5], [0, 0, -1])
    assert hits.primitive[0] >= 0
    scene.contains([[0, 0, 0]]), scene.distance([[0, 0, 0]]), scene.visible([[0, 0, 0]], [5, 5, 5])


def test_nothing_to_do():
    scene = lightpath.RayScene(*TETRAHEDRON)
    none = np.empty((0, 3))
    assert [len(part) for part in scene.closest(none, none)] == [0] * 5
    assert scene.all_hits(none, none).offsets.tolist() == [0]
    assert len(scene.count([], [])) == len(scene.contains(none)) == len(scene.visible(none, [0, 0, 0])) == 0
    assert len(scene.distance(none, signed=True)) == 0


def test_pickles_hold_the_arrays_not_the_tree(sphere):
    vertices, faces, scene = sphere
    data = pickle.dumps(scene)
    assert len(data) < vertices.nbytes + faces.nbytes + 2000
    again = pickle.loads(data)
    assert again.bounds.tolist() == scene.bounds.tolist()
    assert (again.count([0, 0, 0], vertices) == scene.count([0, 0, 0], vertices)).all()


class Scan(lightpath.RayScene):
    """A user's class with an attribute of its own."""


def test_pickles_and_copies_keep_the_class():
    scan = Scan(*cube(), threads=1)
    scan.name = "cube"
    for again in pickle.loads(pickle.dumps(scan)), copy.copy(scan):
        assert type(again) is Scan and again.name == "cube"
        assert again.contains([0, 0, 0]).all()


def test_a_signed_distance_on_the_surface_is_not_negative():
    distance = lightpath.RayScene(*cube()).distance([cube()[0][0], [0, 0, 0]], signed=True)
    assert np.signbit(distance).tolist() == [False, True]


def test_the_progress_of_a_signed_distance_runs_once():
    steps = []
    scene = lightpath.RayScene(*bumpy_sphere(5))
    points = np.random.default_rng(1).uniform(-5000, 5000, (50_000, 3))
    scene.distance(points, signed=True, progress=lambda done, total: steps.append(done / total))
    assert steps == sorted(steps) and steps[-1] == 1 and len(steps) >= 2


def test_progress_reaches_the_end(sphere):
    _, _, scene = sphere
    steps = []
    origins, directions = random_rays(50_000, 4096)
    scene.closest(origins, directions, progress=lambda done, total: steps.append((done, total)))
    assert steps[-1] == (50_000, 50_000)
    steps.clear()
    lightpath.RayScene(*bumpy_sphere(5), progress=lambda done, total: steps.append((done, total)))
    assert steps[-1][0] == steps[-1][1] > 0

    def failing(done, total):
        raise RuntimeError("stop here")

    with pytest.raises(RuntimeError, match="stop here"):
        scene.closest(origins, directions, progress=failing)


def test_queries_release_the_gil(sphere):
    _, _, scene = sphere
    origins, directions = random_rays(400_000, 4096)
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.wait(0.001):
            ticks.append(None)

    thread = threading.Thread(target=tick)
    thread.start()
    before = len(ticks)
    scene.all_hits(origins, directions)
    during = len(ticks) - before
    stop.set()
    thread.join()
    assert during > 5


def test_control_c_stops_a_query():
    script = """
        import signal, sys
        sys.path[:0] = %r
        import numpy as np, lightpath
        from shapes import bumpy_sphere
        # Python leaves an interrupt alone if its parent ignores it, as a job in the background does.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        scene = lightpath.RayScene(*bumpy_sphere(4), threads=1)
        points = np.random.default_rng(0).uniform(-2000, 2000, (30_000_000, 3))
        print("ready", flush=True)
        try:
            scene.distance(points)
        except KeyboardInterrupt:
            print("stopped", flush=True)
    """ % (sys.path,)
    program = [sys.executable, "-c", textwrap.dedent(script)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.3)
        began = time.time()
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(30) == 0
        finally:
            process.kill()
        assert process.stdout.readline() == "stopped\n" and time.time() - began < 5


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer")
def test_a_signal_stops_the_first_query_of_one_point():
    random = np.random.default_rng(0)
    corners = random.random((800_000, 1, 3)) + 0.01 * random.random((800_000, 3, 3))
    scene = lightpath.RayScene(corners.reshape(-1, 3), np.arange(2_400_000).reshape(-1, 3))

    def seconds():
        began = time.perf_counter()
        try:
            scene.winding_number([0, 0, 0])
        except KeyboardInterrupt:
            pass
        return time.perf_counter() - began

    old = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.01)
        first, second = seconds(), seconds()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, old)
    if first + second < 0.15:
        pytest.skip("the query is too fast to be stopped")
    # What the first query did not finish is computed now.
    assert second > first / 4


def test_a_forked_process_has_its_own_threads(sphere):
    import multiprocessing

    _, _, scene = sphere
    scene.count([0, 0, 0], [0, 0, 1])
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("this system does not fork")
    with multiprocessing.get_context("fork").Pool(1) as pool:
        counts = pool.apply_async(scene.count, ([0, 0, 0], [0, 0, 1])).get(20)
    assert counts.tolist() == scene.count([0, 0, 0], [0, 0, 1]).tolist()


def test_a_forked_process_reads_a_file(tmp_path):
    import multiprocessing

    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("this system does not fork")
    path = tmp_path / "many.ply"
    rows = TRIANGLE.replace("face 1", "face 60000").replace("3 0 1 2\n", "3 0 1 2\n" * 60000)
    path.write_text(rows)
    faces = lightpath.RayScene.from_ply(path).num_faces
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(lightpath.RayScene.from_ply, (path,)).get(20).num_faces == faces


def run_script(script, **environment):
    script = "import sys\nsys.path[:0] = %r\n" % (sys.path,) + textwrap.dedent(script)
    command, environment = [sys.executable, "-c", script], {**os.environ, **environment}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="needs a list of threads")
def test_threads_end_with_their_scenes():
    done = run_script("""
        import os, time, lightpath
        from shapes import cube
        kept = lightpath.RayScene(*cube(), threads=3)
        before = len(os.listdir("/proc/self/task"))
        for threads in range(1, 20):
            lightpath.RayScene(*cube(), threads=threads).contains([0, 0, 0])
        assert kept.contains([0, 0, 0])
        for wait in range(100):  # threads end a little later
            if len(os.listdir("/proc/self/task")) > before:
                time.sleep(0.1)
        print(len(os.listdir("/proc/self/task")) - before)
    """)
    assert done.stdout == "0\n", (done.stdout, done.stderr)


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="needs a list of threads")
def test_a_file_is_read_by_as_many_threads_as_asked(tmp_path):
    path = tmp_path / "one.ply"
    path.write_text(TRIANGLE)
    done = run_script(f"""
        import os, lightpath
        before = len(os.listdir("/proc/self/task"))
        lightpath.RayScene.from_ply({str(path)!r}, threads=1)
        print(len(os.listdir("/proc/self/task")) - before)
    """)
    assert done.stdout == "1\n", done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of memory")
@pytest.mark.parametrize("query", ["contains", "winding_number"])
def test_a_lack_of_memory_is_an_exception(query):
    # malloc returns freed arrays of 64 KiB and more at once, and the limit leaves half a MiB.
    done = run_script(f"""
        import resource, numpy as np, lightpath
        n = 250
        x, y = np.meshgrid(np.arange(n, dtype=np.float32), np.arange(n, dtype=np.float32))
        first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
        faces = np.stack([first, first + 1, first + n, first + n, first + 1, first + n + 1], axis=1)
        vertices = np.stack([x, y, np.sin(x)], axis=-1).reshape(-1, 3)
        scene = lightpath.RayScene(vertices, faces.reshape(-1, 3).astype(np.uint32), threads=1)
        scene.closest_point([[1, 2, 3]])
        pages = int(open("/proc/self/statm").read().split()[0])
        limit = pages * resource.getpagesize() + (1 << 19)
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
        try:
            scene.{query}([[1, 2, 3]])
        except MemoryError as error:
            message = str(error)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        print(message, scene.{query}([[1, 2, 3]]))
    """, MALLOC_MMAP_THRESHOLD_="65536", MALLOC_ARENA_MAX="1")
    assert done.returncode == 0 and "no memory for" in done.stdout, (done.returncode, done.stderr)


def test_a_ply_file(tmp_path):
    path = tmp_path / "one.ply"
    path.write_text(TRIANGLE)
    scene = lightpath.RayScene.from_ply(path)
    assert repr(scene) == "RayScene(1 mesh, 1 face)" and scene.nbytes > 0
    with pytest.raises(lightpath.Error, match="nothing.ply"):
        lightpath.RayScene.from_ply(tmp_path / "nothing.ply")


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of memory")
def test_too_many_hits_are_an_exception():
    done = run_script("""
        import resource, numpy as np, lightpath
        layers = np.repeat(np.arange(1000.0), 3)[:, None]
        vertices = np.hstack([np.tile([[-5, -5], [10, -5], [-5, 10.0]], (1000, 1)), layers])
        scene = lightpath.RayScene(vertices, np.arange(3000).reshape(-1, 3), threads=1)
        origins = np.tile([0, 0, -1.0], (3000, 1))
        picture = lightpath.render((vertices, np.arange(3000).reshape(-1, 3)), spp=1, threads=1,
                                   camera={"width": 1200, "height": 900}, layers="Z")
        queries = [lambda: scene.all_hits(origins, [0, 0, 1.0]), picture._picture.pixels,
                   picture._picture.words]
        scene.all_hits(origins[:2], [0, 0, 1.0])
        pages = int(open("/proc/self/statm").read().split()[0])
        limit = pages * resource.getpagesize() + (1 << 20)
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
        for query in queries:
            try:
                query()
                print("ok")
            except MemoryError as error:
                print(str(error).splitlines()[0])
    """, MALLOC_MMAP_THRESHOLD_="65536", MALLOC_ARENA_MAX="1")
    lines = done.stdout.splitlines()
    assert len(lines) == 3 and all("no memory for" in line for line in lines), done
