"""The classes with the methods of trimesh and Open3D, which need not be installed."""

import multiprocessing
import os
import subprocess
import sys

import numpy as np
import pytest

import lightpath
from lightpath.open3d import RaycastingScene
from lightpath.trimesh import RayMeshIntersector
from shapes import bumpy_sphere, cube


def test_the_package_alone_has_them():
    code = "import lightpath; lightpath.trimesh.RayMeshIntersector, lightpath.open3d.RaycastingScene"
    subprocess.run([sys.executable, "-c", code], check=True)


class Mesh:
    """What the adapter uses of a `trimesh.Trimesh`."""

    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces

    @property
    def scale(self):
        return np.linalg.norm(np.ptp(self.vertices, axis=0))

    def __hash__(self):
        return hash(self.vertices.tobytes() + self.faces.tobytes())


def test_trimesh_methods():
    rays = RayMeshIntersector(Mesh(*cube()))
    origins = np.array([[0.1, 0.2, 5], [0.1, 0.2, 0], [9, 9, 9], [0.1, 0.2, 1], [0, 0, 0]])
    directions = np.array([[0, 0, -2.0], [0, 0, 1], [0, 0, -1], [0, 0, -1], [0, 0, 0]])
    locations, index_ray, index_tri = rays.intersects_location(origins, directions)
    assert index_ray.tolist() == [0, 0, 1, 3, 3]
    assert np.allclose(locations[:, 2], [1, -1, 1, 1, -1]) and (index_tri < 12).all()
    assert rays.intersects_any(origins, directions).tolist() == [True, True, False, True, False]
    assert (rays.intersects_first(origins, directions)[[2, 4]] == -1).all()
    tri, ray = rays.intersects_id(origins, directions, multiple_hits=False)
    assert ray.tolist() == [0, 1, 3] and len(tri) == 3
    assert len(rays.intersects_id(origins, directions, max_hits=1)[0]) == 3
    assert rays.contains_points([[0, 0, 0], [2, 2, 2]]).tolist() == [True, False]
    rays.mesh.vertices = rays.mesh.vertices * 3
    assert rays.contains_points([[2, 2, 2]]).tolist() == [True]
    with pytest.raises(ValueError):
        rays.intersects_any(origins, directions[:2])


@pytest.mark.parametrize("length", [5e-324, 1e-310, 1e-161, 1e160, 1.7e308])
def test_trimesh_directions_of_any_length(length):
    rays = RayMeshIntersector(Mesh(*cube()))
    locations, index_ray, _ = rays.intersects_location([[0.1, 0.2, 5]], [[0, 0, -length]])
    assert index_ray.tolist() == [0, 0] and np.allclose(locations[:, 2], [1, -1])


def test_masked_values_are_refused():
    ray = np.ma.array([[0.1, 0.2, 5, 0, 0, -1]], mask=[[0, 0, 1, 0, 0, 1]])
    origin, direction = ray[:, :3], ray[:, 3:]
    scene, rays = RaycastingScene(), RayMeshIntersector(Mesh(*cube()))
    scene.add_triangles(*cube())
    masked_mesh = RayMeshIntersector(Mesh(np.ma.array(cube()[0], mask=cube()[0] > 0), cube()[1]))
    for name, query in {
        "rays": lambda: scene.cast_rays(ray),
        "tnear": lambda: scene.test_occlusions(ray.data, tnear=np.ma.array([1.0], mask=[1])),
        "tfar": lambda: scene.test_occlusions(ray.data, tfar=np.ma.array([1.0], mask=[1])),
        "query_points": lambda: scene.compute_distance(origin),
        "eye": lambda: scene.create_rays_pinhole(60, [0, 0, 0], origin[0], [0, 1, 0], 8, 6),
        "intrinsic_matrix": lambda: scene.create_rays_pinhole(
            np.ma.array(np.eye(3), mask=np.eye(3)), np.eye(4), 8, 6),
        "ray_origins": lambda: rays.intersects_first(origin, direction.data),
        "ray_directions": lambda: rays.intersects_any(origin.data, direction),
        "points": lambda: rays.contains_points(origin),
        "vertices": lambda: masked_mesh.intersects_any(origin.data, direction.data),
    }.items():
        with pytest.raises(ValueError, match=f"^{name}: found masked values"):
            query()
    assert np.isfinite(scene.cast_rays(np.ma.array(ray.data, mask=False))["t_hit"]).all()


def test_open3d_methods():
    scene = RaycastingScene()
    assert scene.add_triangles(*cube()) == 0 and scene.add_triangles(cube()[0] + 5, cube()[1]) == 1
    rays = np.array([[[0.1, 0.2, 9, 0, 0, -1], [5.1, 5.2, 9, 0, 0, -1]], [[0, 0, 9, 0, 0, 1]] * 2])
    hits = scene.cast_rays(rays)
    assert hits["t_hit"].tolist() == [[8, 3], [np.inf] * 2]
    assert hits["geometry_ids"].tolist() == [[0, 1], [scene.INVALID_ID] * 2]
    assert hits["primitive_normals"][0, 0].tolist() == [0, 0, 1]
    assert scene.test_occlusions(rays).tolist() == [[True, True], [False, False]]
    assert scene.count_intersections(rays).tolist() == [[2, 2], [0, 0]]
    every = scene.list_intersections(rays)
    assert every["ray_splits"].tolist() == [0, 2, 4, 4, 4] and every["ray_ids"].tolist() == [0, 0, 1, 1]
    points = [[0, 0, 0], [0, 0, 3]]
    assert scene.compute_signed_distance(points).tolist() == [-1, 2]
    assert scene.compute_occupancy(points).tolist() == [1, 0]
    assert scene.compute_distance(points).tolist() == [1, 2]
    assert scene.compute_closest_points(points)["points"][1].tolist() == [0, 0, 1]


def test_open3d_types():
    scene = RaycastingScene()
    scene.add_triangles(*cube())
    rays, points = [[0.1, 0.2, 9, 0, 0, -1], [9, 9, 9, 0, 0, 1]], [[0.1, 0.2, 9], [3, 0, 0]]
    results = {**scene.list_intersections(rays), **scene.cast_rays(rays), **scene.compute_closest_points(points)}
    whole = {"ray_splits", "ray_ids", "geometry_ids", "primitive_ids"}
    for name, array in results.items():
        assert array.dtype == (np.uint32 if name in whole else np.float32), name


def test_open3d_closest_points_have_places_on_their_faces():
    scene, (vertices, faces) = RaycastingScene(), bumpy_sphere(1)
    scene.add_triangles(vertices * 1e-4, faces)
    # Faces without area: a corner twice, and a corner between the two others in each order.
    line = np.array([[9.0, 0, 0], [9, 0, 1], [9, 0, 3]])
    scene.add_triangles(line, [[0, 0, 2], [0, 2, 1], [1, 0, 2], [2, 1, 0], [0, 1, 1]])
    points = np.random.default_rng(3).uniform(-1, 1, (400, 3))
    points = np.concatenate([points, [[9.1, 0, z] for z in np.linspace(-1, 4, 50)]]).reshape(3, 150, 3)
    found = scene.compute_closest_points(points)
    u, v = np.moveaxis(found["primitive_uvs"], -1, 0)
    assert u.shape == (3, 150) and (u >= 0).all() and (v >= 0).all() and (u + v < 1.00001).all()
    has_area = 0
    for index in np.ndindex(u.shape):
        vertices, faces = scene.scene.meshes[found["geometry_ids"][index]]
        a, b, c = vertices[faces[found["primitive_ids"][index]]]
        point = a + u[index] * (b - a) + v[index] * (c - a)
        assert np.allclose(point, found["points"][index], atol=1e-6)
        normal = np.cross(b - a, c - a)
        if normal.any():
            has_area += 1
            expected = normal / np.linalg.norm(normal)
            assert np.allclose(expected, found["primitive_normals"][index], atol=1e-6)
        else:
            assert np.isnan(found["primitive_normals"][index]).all()
    assert has_area == 400


def test_open3d_cameras():
    """The numbers are those of Open3D 0.20."""
    make = RaycastingScene.create_rays_pinhole
    rays = make(60, [0, 0, 0], [1, 2, 3], [0, 1, 0], 4, 3)
    assert rays.shape == (3, 4, 6) and rays.dtype == np.float32
    assert np.allclose(rays[0, 0], [1, 2, 3, 0.19232568, -0.7784975, -0.7923293])
    assert np.allclose(rays[2, 1], [1, 2, 3, -0.17912562, -0.2905475, -0.99381226])
    intrinsic = np.array([[100, 0, 50], [0, 100, 40], [0, 0, 1.0]])
    extrinsic = np.eye(4)
    extrinsic[2, 3] = 4
    rays = make(Tensor(intrinsic), Tensor(extrinsic), width_px=4, height_px=3)
    assert np.allclose(rays[1, 2], [0, 0, -4, -0.475, -0.385, 1])
    for bad, message in [
        ((intrinsic, intrinsic, 4, 3), r"extrinsic_matrix: found shape \(3, 3\), expected \(4, 4\)"),
        ((60, [0, 0, 0], [0, 0], [0, 1, 0], 4, 3), r"eye: found shape \(2,\)"),
        ((60, [0, 0, 0], [0, 5, 0], [0, 1, 0], 4, 3), "up: found a view without direction"),
    ]:
        with pytest.raises(ValueError, match=message):
            make(*bad)


class Tensor:
    """What the adapter uses of a tensor of Open3D."""

    def __init__(self, array):
        self.array = array

    def numpy(self):
        return self.array


def add_many():
    many = np.repeat([[0, 1, 2]], 20_000, axis=0)  # checked by several threads
    return lightpath.open3d.RaycastingScene(nthreads=1).add_triangles(np.eye(3), many)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_open3d_meshes_are_added_in_a_forked_process():
    add_many()
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(add_many).get(20) == 0


def test_open3d_meshes_are_checked_when_they_are_added():
    vertices, faces = cube()
    scene = RaycastingScene()
    for bad, kind, message in [
        ((vertices, faces + 7), ValueError, r"^faces\[0, 1\]: found vertex 9, expected 0 to 7"),
        ((vertices * np.nan, faces), ValueError, r"^vertices\[0\]: found \[NaN"),
        ((vertices, faces * 1.0), TypeError, "faces: found dtype float64"),
        ((Tensor(vertices), Tensor(faces[:0])), ValueError, "faces: found no face"),
    ]:
        with pytest.raises(kind, match=message):
            scene.add_triangles(*bad)
    with pytest.raises(ValueError, match="threads: found -1"):
        RaycastingScene(nthreads=-1)
    assert scene.add_triangles(Tensor(vertices), Tensor(faces)) == 0
    assert scene.cast_rays(Tensor(np.array([[0.1, 0.2, 9, 0, 0, -1]])))["t_hit"].tolist() == [8]
    assert scene.compute_distance(Tensor(np.array([[0.0, 0, 3]]))).tolist() == [2]


def test_open3d_rays_that_cannot_hit_miss():
    scene = RaycastingScene()
    good = [0.1, 0.2, 9, 0, 0, -1]
    rays = [good, [0.1, 0.2, 9, 0, 0, 0], [0, 0, np.nan, 0, 0, 1], [0, 0, 9, 0, np.inf, -1]]
    for expected in [[np.inf] * 4, [8] + [np.inf] * 3]:
        hits = scene.cast_rays(rays)
        assert hits["t_hit"].tolist() == expected
        assert (hits["primitive_ids"] == scene.INVALID_ID).tolist() == np.isinf(expected).tolist()
        assert scene.test_occlusions(rays).tolist() == np.isfinite(expected).tolist()
        assert scene.count_intersections(rays).tolist() == [2 * (t < np.inf) for t in expected]
        assert len(scene.list_intersections(rays)["t_hit"]) == 2 * (expected[0] < np.inf)
        scene.add_triangles(*cube())


class Cloud:
    vertices = points = np.zeros((3, 3))


class Scene:
    """What `trimesh.Scene` has in common with meshes."""

    geometry, triangles = {}, np.zeros((0, 3, 3))


@pytest.mark.parametrize("thing", [Cloud(), Scene(), None])
def test_things_that_are_no_mesh(thing):
    for make, expected in [
        (lightpath.RayScene.from_trimesh, "expected a trimesh.Trimesh"),
        (lightpath.RayScene.from_open3d, "expected a triangle mesh of Open3D"),
        (lightpath.render, "expected a file, dict or mesh"),
    ]:
        with pytest.raises(TypeError, match=expected) as caught:
            make(thing)
        assert ("to_geometry" in str(caught.value)) == isinstance(thing, Scene)
