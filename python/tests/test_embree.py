"""`RayScene` with the backend Embree, which the system may lack."""

import os
import pickle
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import lightpath
from shapes import TETRAHEDRON, bumpy_sphere, cube


def why_absent():
    try:
        lightpath.RayScene(*TETRAHEDRON, backend="embree")
    except lightpath.Error as error:
        ((place, message, _),) = error.problems
        # CI has it. Any other error is one of the module.
        absent = place == "Embree" and message.startswith("cannot load libembree4")
        if not absent or "LIGHTPATH_NO_SKIPS" in os.environ:
            raise
        return message
    return ""


ABSENT = why_absent()
needs_embree = pytest.mark.skipif(ABSENT != "", reason=ABSENT)


def rays(count, radius, middle, seed=5):
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * radius
    return origins + middle, rng.uniform(-0.6, 0.6, (count, 3)) * radius - origins


@needs_embree
@pytest.mark.parametrize("dtype, middle", [(np.float32, 0.0), (np.float64, 4_100_000.7)])
def test_closest_and_occluded_are_those_of_bvh(dtype, middle):
    vertices, faces = bumpy_sphere(4)
    meshes = [(vertices.astype(dtype) + dtype(middle), faces), ((vertices * 0.3).astype(dtype) + dtype(middle), faces)]
    bvh = lightpath.RayScene.from_meshes(meshes)
    embree = lightpath.RayScene.from_meshes(meshes, backend="embree", threads=2)
    assert bvh.backend == "bvh" and embree.backend == "embree" and embree.nbytes > 0
    assert (embree.bounds == bvh.bounds).all() and embree.is_closed == bvh.is_closed
    origins, directions = rays(20_000, 4096, middle)
    first = bvh.closest(origins, directions).t
    for limits in [(0.0, np.inf), (0.3, 0.8), (np.where(first < np.inf, first, 0.0), np.inf)]:
        found, expected = embree.closest(origins, directions, *limits), bvh.closest(origins, directions, *limits)
        assert (found.t == expected.t).all() and (found.primitive == expected.primitive).all()
        assert (found.mesh == expected.mesh).all() and (found.normal == expected.normal).all()
        assert np.array_equal(found.barycentrics, expected.barycentrics, equal_nan=True)
        assert set(found.mesh.tolist()) == {-1, 0, 1}
        assert (embree.occluded(origins, directions, *limits) == (found.mesh >= 0)).all()


@needs_embree
def test_other_queries_name_the_backend_that_answers_them():
    scene = lightpath.RayScene(*TETRAHEDRON, backend="embree")
    ray, point = ([[0.2, 0.2, 2]], [[0, 0, -1]]), [[0.1, 0.1, 0.1]]
    queries = [
        lambda: scene.count(*ray), lambda: scene.all_hits(*ray), lambda: scene.contains(point),
        lambda: scene.winding_number(point), lambda: scene.closest_point(point),
        lambda: scene.distance(point, signed=True), lambda: scene.visible(point, [0, 0, 5]),
    ]
    for query in queries:
        with pytest.raises(lightpath.Error, match="backend: found `embree`(.|\n)*`bvh`, the default"):
            query()


@needs_embree
def test_a_pickle_keeps_the_backend():
    scene = pickle.loads(pickle.dumps(lightpath.RayScene(*cube(), backend="embree", threads=1)))
    assert scene.backend == "embree" and scene.closest([0.1, 0.2, 5], [0, 0, -1]).t.tolist() == [4]
    assert scene._repr_png_()[:4] == b"\x89PNG"


@needs_embree
def test_the_scene_keeps_what_embree_reads():
    """Many scenes at once, whose arrays and other references are gone."""
    scenes = [lightpath.RayScene(cube()[0] * (i + 1), cube()[1], backend="embree") for i in range(40)]
    _ = [np.ones(1000) for _ in range(1000)]
    for i, scene in enumerate(scenes):
        assert np.isclose(scene.closest([0.1, 0.2, 99], [0, 0, -1]).t[0], 98 - i, rtol=1e-14)
        assert scene.occluded([0.1, 0.2, 99], [[0, 0, -1], [0, 0, 1]]).tolist() == [True, False]


@needs_embree
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    arrays.arrays(np.float64, (8, 3), elements=st.floats(-1e18, 1e18) | st.sampled_from([0.0, 1.0, 1e-300])),
    arrays.arrays(np.int32, (12, 3), elements=st.integers(0, 7)),
    arrays.arrays(np.float64, (20, 3), elements=st.floats(-1e18, 1e18) | st.sampled_from([0.0, -1.0, 0.25])),
)
def test_any_mesh(vertices, faces, points):
    scene = lightpath.RayScene(vertices, faces, backend="embree", threads=1)
    hits = scene.closest(points, [0, 0.5, 1])
    assert ((hits.primitive < 12) & (hits.mesh < 1)).all()
    scene.occluded(points, [0, 0, -1])


def test_an_unknown_backend():
    with pytest.raises(lightpath.Error, match="backend: found `optix`, expected `bvh` or `embree`"):
        lightpath.RayScene(*TETRAHEDRON, backend="optix")
    with pytest.raises(TypeError, match="backend"):
        lightpath.RayScene(*TETRAHEDRON, backend=4)


def test_embree_is_loaded_on_request():
    """Also what is raised where the dynamic loader does not find it."""
    script = """
        import lightpath
        from shapes import TETRAHEDRON
        lightpath.RayScene(*TETRAHEDRON).occluded([0.2, 0.2, 2], [0, 0, -1])
        assert "embree" not in open("/proc/self/maps").read()
        try:
            lightpath.RayScene(*TETRAHEDRON, backend="embree")
            assert "embree" in open("/proc/self/maps").read()
        except lightpath.Error as error:
            (place, message, help), = error.problems
            assert place == "Embree" and message.startswith("cannot load libembree4"), error
    """
    folders = [os.path.dirname(os.path.dirname(lightpath.__file__)), *sys.path]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, folders))}
    environment.pop("LD_LIBRARY_PATH", None)
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], env=environment, check=True)
