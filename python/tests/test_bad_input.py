"""Bad input raises an exception that names the place. Nothing crashes."""

import errno
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import lightpath
from shapes import TETRAHEDRON

VERTICES, FACES = TETRAHEDRON
SCENE = lightpath.RayScene(VERTICES, FACES)
RAY = [[0.2, 0.2, 2.0]], [[0.0, 0.0, -1.0]]


def changed(array, index, value, dtype=None):
    array = array.astype(dtype or array.dtype)
    array[index] = value
    return array


MESHES = [
    (VERTICES[:, :2], FACES, ValueError, r"vertices: found shape \(4, 2\), expected \(n, 3\)"),
    (VERTICES.ravel(), FACES, ValueError, r"vertices: found shape \(12,\)"),
    (VERTICES, FACES[:, :2], ValueError, r"faces: found shape \(4, 2\)"),
    (VERTICES, FACES.astype(float), TypeError, "faces: found dtype float64, expected integers"),
    (VERTICES.astype(complex), FACES, TypeError, "vertices: found dtype complex128"),
    (VERTICES.astype(str), FACES, TypeError, "vertices: found dtype"),
    (VERTICES.astype(object), FACES, TypeError, "vertices: found dtype object"),
    ([[0, 0, 0], [1, 0]], FACES, ValueError, "vertices: "),
    (changed(VERTICES, (2, 1), np.nan), FACES, ValueError, r"vertices\[2\]: found \[0.0, NaN, 0.0\]"),
    (changed(VERTICES, (3, 0), np.inf), FACES, ValueError, r"vertices\[3\]: found \[inf"),
    (changed(VERTICES, (3, 0), 1e30), FACES, ValueError, r"vertices\[3\]: .* up to 1e18"),
    (VERTICES, changed(FACES, (1, 2), 4), ValueError, r"faces\[1, 2\]: found vertex 4, expected 0 to 3"),
    (VERTICES, changed(FACES, (1, 2), -1), ValueError, r"faces\[1, 2\]: found vertex -1"),
    (VERTICES, changed(FACES, (3, 0), 2**63 + 5, np.uint64), ValueError, r"faces\[3, 0\]: found vertex 9223"),
    (VERTICES, FACES[:0], ValueError, "faces: found no face, expected at least one"),
    (VERTICES, FACES[:0].astype(bool), ValueError, "faces: found no face, expected at least one"),
    (VERTICES[:0], FACES, ValueError, r"faces\[0, 0\]: found vertex 0, expected 0 to -1"),
    (None, FACES, TypeError, "vertices: found dtype object"),
    (np.ma.array(VERTICES, mask=VERTICES > 0), FACES, ValueError, "vertices: found masked values"),
]


@pytest.mark.parametrize("vertices, faces, kind, message", MESHES)
def test_meshes(vertices, faces, kind, message):
    with pytest.raises(kind, match=message):
        lightpath.RayScene(vertices, faces)
    with pytest.raises(kind, match="mesh 1: "):
        lightpath.RayScene.from_meshes([(VERTICES, FACES), (vertices, faces)])


RAYS = [
    (([[0, 0]], RAY[1]), ValueError, r"origins: found shape \(1, 2\), expected \(n, 3\)"),
    ((RAY[0], [[[0, 0, 1]]]), ValueError, r"directions: found shape \(1, 1, 3\)"),
    ((np.zeros((4, 3)), np.ones((5, 3))), ValueError, r"directions: found shape \(5, 3\), expected \(4, 3\)"),
    (([[0, 0, np.nan]], RAY[1]), ValueError, r"origins\[0\]: found \[0.0, 0.0, NaN\]"),
    ((RAY[0], [[np.inf, 0, 0]]), ValueError, r"directions\[0\]: found \[inf"),
    ((np.zeros((7, 3)), changed(np.ones((7, 3)), 5, 0)), ValueError, r"directions\[5\]: found \[0.0, 0.0, 0.0\]"),
    ((RAY[0], [["a", "b", "c"]]), TypeError, "directions: found dtype"),
    ((RAY[0], [[1j, 0, 0]]), TypeError, "directions: found dtype complex128"),
    ((*RAY, -1.0), ValueError, "tnear: found -1, expected a number >= 0 or infinity"),
    ((*RAY, np.nan), ValueError, "tnear: found NaN"),
    ((*RAY, 0.0, -2.0), ValueError, "tfar: found -2, expected a number >= 0 or infinity"),
    ((*RAY, 0.0, [np.nan]), ValueError, "tfar: found NaN"),
    ((np.zeros((3, 3)), [0, 0, 1], 0.0, [1, 1, -1]), ValueError, r"tfar\[2\]: found -1"),
    ((*RAY, 0.0, [1, 2]), ValueError, r"tfar: found shape \(2,\), expected a number or \(1,\)"),
    ((*RAY, "0"), TypeError, "tnear: found dtype"),
]


@pytest.mark.parametrize("query", ["closest", "occluded", "count", "all_hits"])
@pytest.mark.parametrize("rays, kind, message", RAYS)
def test_rays(query, rays, kind, message):
    with pytest.raises(kind, match=message):
        getattr(SCENE, query)(*rays)


POINTS = [
    ([[0, 0]], ValueError, r": found shape \(1, 2\), expected \(n, 3\)"),
    ([[0, 0, 0], [0, np.nan, 0]], ValueError, r"\[1\]: found \[0.0, NaN, 0.0\]"),
    ([[0, 0, 1e19]], ValueError, r"\[0\]: .* up to 1e18"),
    ([["x", "y", "z"]], TypeError, ": found dtype"),
    (np.ma.array([[0.0, 0, 0]], mask=[[1, 0, 0]]), ValueError, ": found masked values"),
]


@pytest.mark.parametrize("query", ["contains", "distance", "closest_point", "winding_number"])
@pytest.mark.parametrize("points, kind, message", POINTS)
def test_points(query, points, kind, message):
    with pytest.raises(kind, match="points" + message):
        getattr(SCENE, query)(points)
    with pytest.raises(kind, match="points" + message):
        SCENE.visible(points, [0, 0, 0])
    with pytest.raises(kind, match="from_" + message):
        SCENE.visible([0, 0, 0], points)


def test_2_to_the_32_rays_are_too_many():
    many = np.broadcast_to(np.zeros(3), (2**32, 3))
    with pytest.raises(ValueError, match="origins: found 4294967296 rows, expected fewer than"):
        SCENE.closest(many, [0, 0, 1])
    with pytest.raises(ValueError, match="vertices: found 4294967296 rows"):
        lightpath.RayScene(many, FACES)


@pytest.mark.parametrize("threads, kind", [(0, ValueError), (-1, ValueError), (1.5, TypeError), ("2", TypeError), (10**9, ValueError)])
def test_threads(threads, kind):
    with pytest.raises(kind, match="threads: found"):
        lightpath.RayScene(VERTICES, FACES, threads=threads)


def test_visible_needs_one_or_as_many_points():
    with pytest.raises(ValueError, match="from_: found 2 points, expected 1 or 3"):
        SCENE.visible(np.zeros((3, 3)), np.zeros((2, 3)))


def test_one_point_is_visible_from_one_point():
    with pytest.raises(ValueError, match="from_: found 2 points, expected 1$"):
        SCENE.visible([2, 2, 2], np.zeros((2, 3)))


def test_a_backend_is_a_string():
    with pytest.raises(TypeError, match="backend: found None, expected a string"):
        lightpath.RayScene(VERTICES, FACES, backend=None)


def test_errors_of_files_are_errors_of_the_system(tmp_path):
    (tmp_path / "scan.ply").write_bytes(b"")
    scene = {"camera": {}, "scene": {"shapes": []}}
    for call in [
        lambda: lightpath.RayScene.from_ply(tmp_path / "no.ply"),
        lambda: lightpath.render(tmp_path / "no.json"),
        lambda: lightpath.render(tmp_path / "no.ply"),
    ]:
        with pytest.raises(FileNotFoundError) as caught:
            call()
        assert isinstance(caught.value, lightpath.Error) and len(caught.value.problems) == 1
    for call in [lambda: lightpath.render(scene), lambda: lightpath.render(tmp_path / "scan.ply")]:
        with pytest.raises(lightpath.Error) as caught:
            call()
        assert not isinstance(caught.value, OSError)
    folder = tmp_path / "folder.exr"
    folder.mkdir()
    picture = lightpath.render((VERTICES, FACES), camera={"width": 4, "height": 4}, spp=1)
    kinds = {errno.ENOENT: FileNotFoundError, errno.EISDIR: IsADirectoryError, errno.ENOTDIR: NotADirectoryError}
    scene["scene"]["shapes"] = [{"type": "trimesh", "path": str(tmp_path / "no.ply"), "material": {}}]
    scene["camera"] = {"type": "pinhole", "width": 4, "height": 4, "fov": 40, "position": [0, 0, 6],
                       "target": [0, 0, 0], "up": [0, 1, 0]}
    for call, number, name in [
        (lambda: lightpath.RayScene.from_ply(tmp_path / "no.ply"), errno.ENOENT, "no.ply"),
        (lambda: lightpath.RayScene.from_ply(tmp_path), errno.EISDIR, ""),
        (lambda: lightpath.render(tmp_path / "scan.ply" / "a.ply"), errno.ENOTDIR, "scan.ply/a.ply"),
        (lambda: lightpath.render(scene), errno.ENOENT, "no.ply"),
        (lambda: picture.write(tmp_path / "no" / "x"), errno.ENOENT, "no/x.exr"),
        (lambda: picture.write(tmp_path / "scan.ply" / "x"), errno.ENOTDIR, "scan.ply/x.exr"),
        (lambda: picture.write_exr(tmp_path / "no" / "x.exr"), errno.ENOENT, "no/x.exr"),
        (lambda: picture.write_exr("/proc/x.exr"), errno.ENOENT, "/proc/x.exr"),
        (lambda: picture.write_exr(folder), errno.EISDIR, "folder.exr"),
    ]:
        with pytest.raises(lightpath.FileError) as caught:
            call()
        error = caught.value
        assert (error.errno, error.filename) == (number, str(tmp_path / name)), str(error)
        for of, kind in kinds.items():
            assert isinstance(error, kind) == (number == of)
        assert "/.lightpath-" not in str(error) and str(error).endswith(error.problems[-1][2] or "")
        again = pickle.loads(pickle.dumps(error))
        assert (str(again), again.errno, again.problems) == (str(error), error.errno, error.problems)
        assert type(again) is type(error)
    assert issubclass(lightpath.FileError, OSError) and issubclass(lightpath.FileError, ValueError)


def test_a_passing_error_of_a_file_has_its_number():
    """The first page of a process's memory cannot be read."""
    with pytest.raises(lightpath.FileError) as caught:
        lightpath.RayScene.from_ply("/proc/self/mem")
    assert caught.value.errno == errno.EIO and caught.value.filename == "/proc/self/mem"


def test_the_name_of_a_file_is_a_string_or_a_path():
    for path in [b"a.ply", 3, None]:
        with pytest.raises(TypeError, match="path: found .*, expected a string or a path"):
            lightpath.RayScene.from_ply(path)


def test_arrays_need_not_be_aligned():
    shifted = np.frombuffer(b"x" + np.full((2, 3), 0.1).tobytes(), np.float64, offset=1)
    points = shifted.reshape(2, 3)
    assert not points.flags.aligned and SCENE.contains(points).all()
    hits = SCENE.closest(points, [0, 0, 1], shifted[:2] * 0, shifted[:2])
    assert (hits.primitive == -1).all()


def test_messages_have_no_flags_of_the_program(tmp_path):
    path = tmp_path / "bad.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    for text in [head + face + "0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", head + "end_header\n0 0 0\n1 0 0\n0 1 0\n"]:
        path.write_text(text)
        with pytest.raises(lightpath.Error, match="bad.ply") as caught:
            lightpath.RayScene.from_ply(path)
        assert "--" not in str(caught.value)
    with pytest.raises(lightpath.Error, match="^/camera/fov: found 400") as caught:
        lightpath.render((VERTICES, FACES), camera={"fov": 400})
    assert caught.value.problems[0][0] == "/camera/fov"
    with pytest.raises(ValueError, match="settings: found '/a=b', expected a JSON pointer without"):
        lightpath.render((VERTICES, FACES), settings={"/a=b": 4})
    with pytest.raises(ValueError, match="camera: found 'a=b', expected a key without"):
        lightpath.render((VERTICES, FACES), camera={"a=b": 4})


def test_the_error_lists_its_problems():
    with pytest.raises(lightpath.Error) as caught:
        lightpath.RayScene(VERTICES, FACES + 9)
    assert caught.value.problems == [("faces[0, 0]", "found vertex 9, expected 0 to 3", None)]


ANY_ARRAY = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.float16, np.int64, np.int8, np.uint64, np.bool_, np.complex64]),
    arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5),
)
NUMBERS = st.floats() | st.sampled_from([0.0, -0.0, 1e-320, 1e300, 1e18, -1e18, 0.25, 1.0])
ROWS = st.integers(0, 20).flatmap(lambda n: arrays.arrays(np.float64, (n, 3), elements=NUMBERS))
LENIENT = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
QUERIES = ["closest", "occluded", "count", "all_hits"]


@LENIENT
@given(ANY_ARRAY | ROWS, ANY_ARRAY | ROWS, NUMBERS, NUMBERS, st.sampled_from(QUERIES))
def test_any_rays(origins, directions, tnear, tfar, query):
    try:
        getattr(SCENE, query)(origins, directions, tnear, tfar)
    except (ValueError, TypeError) as error:
        assert str(error).split(":")[0].split("[")[0] in ("origins", "directions", "tnear", "tfar")


@LENIENT
@given(ANY_ARRAY | ROWS, st.sampled_from(["contains", "distance", "winding_number", "visible"]))
def test_any_points(points, query):
    more = ([0.5, 0.5, 0.5],) if query == "visible" else ()
    try:
        getattr(SCENE, query)(points, *more)
    except (ValueError, TypeError) as error:
        assert str(error).startswith("points")


@LENIENT
@given(
    ANY_ARRAY | arrays.arrays(np.float64, (8, 3), elements=st.floats(-1e18, 1e18) | st.sampled_from([0.0, 1.0, 1e-300])),
    ANY_ARRAY | arrays.arrays(np.int32, (12, 3), elements=st.integers(-1, 8) | st.integers(0, 7)),
    ROWS,
)
def test_any_mesh(vertices, faces, points):
    """Any mesh is refused, or can be queried."""
    try:
        scene = lightpath.RayScene(vertices, faces)
    except (ValueError, TypeError) as error:
        assert str(error).split(":")[0].split("[")[0] in ("vertices", "faces")
        return
    points = points[np.isfinite(points).all(axis=1) & (np.abs(points) <= 1e18).all(axis=1)]
    scene.contains(points), scene.distance(points), scene.visible(points, [0, 0, 0])
    directions = np.where((points == 0).all(axis=1)[:, None], 1.0, points)
    counts = scene.count([0, 0, 0], directions)
    hits = scene.all_hits([0, 0, 0], directions)
    assert (np.diff(hits.offsets) == counts).all()
    scene.closest(points, [0, 0.5, 1]), scene.occluded(points, [0, 0, -1])


def test_a_mesh_that_is_no_pair_is_named():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    for wrong in (corners, 7):
        with pytest.raises(ValueError, match="mesh 1: expected a pair: vertices, faces"):
            lightpath.RayScene.from_meshes([(corners, [[0, 1, 2]]), wrong])
