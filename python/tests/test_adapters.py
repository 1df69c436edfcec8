"""The classes with the methods of trimesh and Open3D, which need not be installed."""

import subprocess
import sys

import numpy as np
import pytest

from lightpath.open3d import RaycastingScene
from lightpath.trimesh import RayMeshIntersector
from shapes import cube


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
