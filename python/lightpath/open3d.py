"""The methods of Open3D's `RaycastingScene`. Results are numpy arrays instead of tensors.

Open3D itself is not needed.
"""

import numpy as np

from . import _convert
from ._lightpath import check_mesh
from ._rays import RayScene

# Stands for no mesh. Its face is never hit: the rays of an empty scene have no length.
STAND_IN = np.eye(3), np.array([[0, 1, 2]])


class RaycastingScene:
    """Triangle meshes and queries, with the method names of `open3d.t.geometry.RaycastingScene`.

    Rays are (..., 6) arrays or tensors of origin and direction. Results have the shape (...), except
    those of `list_intersections`. A ray that is not finite or has no direction hits nothing. The
    methods ignore `nthreads` and `nsamples`.

    Parameters
    ----------
    nthreads : int, optional
        Number of threads; 0 for one per processor.

    Examples
    --------
    >>> from lightpath.open3d import RaycastingScene
    >>> scene = RaycastingScene()
    >>> scene.add_triangles([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    0
    >>> scene.cast_rays([[0.2, 0.2, 2, 0, 0, -1]])["t_hit"]
    array([2.], dtype=float32)
    """

    INVALID_ID = 0xFFFFFFFF

    def __init__(self, nthreads=0):
        self._threads = _convert.threads(nthreads or None)
        self._meshes = []
        self._scene = None

    def add_triangles(self, vertices, triangles=None):
        """Add a mesh: arrays or tensors of vertices and faces, or a mesh of Open3D.

        Returns its id. Raises the exceptions of `RayScene`.
        """
        if triangles is None:
            vertices, triangles = _convert.open3d_arrays(vertices)
        arrays = _convert.mesh(_convert.array(vertices), _convert.array(triangles))
        check_mesh(*arrays)
        self._meshes.append(tuple(array.copy() for array in arrays))
        self._scene = None
        return len(self._meshes) - 1

    @property
    def scene(self):
        """The `lightpath.RayScene` of all meshes."""
        if self._scene is None:
            self._scene = RayScene.from_meshes(self._meshes, threads=self._threads)
        return self._scene

    def _rays(self, rays, tnear=0.0, tfar=np.inf):
        """Return the scene, the shape of the results, and the arguments of a query."""
        rays = np.asarray(_convert.array(rays), dtype=np.float64)
        if rays.ndim == 0 or rays.shape[-1] != 6:
            raise ValueError(f"rays: found shape {rays.shape}, expected (..., 6)")
        flat = rays.reshape(-1, 6)
        can_hit = np.isfinite(flat).all(axis=1) & flat[:, 3:].any(axis=1) & bool(self._meshes)
        flat = np.where(can_hit[:, np.newaxis], flat, [0.0, 0, 0, 0, 0, 1])
        scene = self.scene if self._meshes else RayScene(*STAND_IN, threads=1)
        limits = tnear, np.where(can_hit, tfar, 0.0)
        return scene, rays.shape[:-1], (flat[:, :3], flat[:, 3:], *limits)

    @staticmethod
    def _points(points):
        points = np.asarray(_convert.array(points), dtype=np.float64)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise ValueError(f"query_points: found shape {points.shape}, expected (..., 3)")
        return points.shape[:-1], points.reshape(-1, 3)

    def _ids(self, indices):
        return np.where(indices < 0, self.INVALID_ID, indices).astype(np.uint32)

    def cast_rays(self, rays, nthreads=0):
        """Find the closest hit of each ray.

        Returns a dict of t_hit, geometry_ids, primitive_ids, primitive_uvs and primitive_normals. A
        miss has t_hit inf and ids `INVALID_ID`.
        """
        scene, shape, query = self._rays(rays)
        hits = scene.closest(*query)
        uvs = np.nan_to_num(hits.barycentrics, nan=0.0).astype(np.float32)
        return {
            "t_hit": hits.t.astype(np.float32).reshape(shape),
            "geometry_ids": self._ids(hits.mesh).reshape(shape),
            "primitive_ids": self._ids(hits.primitive).reshape(shape),
            "primitive_uvs": uvs.reshape(*shape, 2),
            "primitive_normals": hits.normal.astype(np.float32).reshape(*shape, 3),
        }

    def test_occlusions(self, rays, tnear=0.0, tfar=np.inf, nthreads=0):
        """Return whether each ray hits any face."""
        scene, shape, query = self._rays(rays, tnear, tfar)
        return scene.occluded(*query).reshape(shape)

    def count_intersections(self, rays, nthreads=0):
        """Return the number of hits along each ray."""
        scene, shape, query = self._rays(rays)
        return scene.count(*query).astype(np.int32).reshape(shape)

    def list_intersections(self, rays, nthreads=0):
        """Find all hits along each ray.

        Returns a dict of ray_splits, ray_ids, t_hit, geometry_ids, primitive_ids and
        primitive_uvs. The hits of ray i have the indices ``ray_splits[i]:ray_splits[i + 1]``.
        """
        scene, _, query = self._rays(rays)
        hits = scene.all_hits(*query)
        ray_ids = np.repeat(np.arange(len(query[0])), np.diff(hits.offsets))
        return {
            "ray_splits": hits.offsets,
            "ray_ids": ray_ids,
            "t_hit": hits.t.astype(np.float32),
            "geometry_ids": self._ids(hits.mesh),
            "primitive_ids": self._ids(hits.primitive),
            "primitive_uvs": hits.barycentrics.astype(np.float32),
        }

    def compute_closest_points(self, query_points, nthreads=0):
        """Return the nearest points: a dict of points, geometry_ids and primitive_ids."""
        shape, points = self._points(query_points)
        nearest = self.scene.closest_point(points)
        return {
            "points": nearest.point.astype(np.float32).reshape(*shape, 3),
            "geometry_ids": self._ids(nearest.mesh).reshape(shape),
            "primitive_ids": self._ids(nearest.primitive).reshape(shape),
        }

    def compute_distance(self, query_points, nthreads=0):
        """Return the distance of each point from the meshes."""
        shape, points = self._points(query_points)
        return self.scene.distance(points).astype(np.float32).reshape(shape)

    def compute_signed_distance(self, query_points, nthreads=0, nsamples=1):
        """Return the distance of each point, negative inside: see `RayScene.contains`."""
        shape, points = self._points(query_points)
        return self.scene.distance(points, signed=True).astype(np.float32).reshape(shape)

    def compute_occupancy(self, query_points, nthreads=0, nsamples=1):
        """Return 1 for points inside, else 0: see `RayScene.contains`."""
        shape, points = self._points(query_points)
        return self.scene.contains(points).astype(np.float32).reshape(shape)
