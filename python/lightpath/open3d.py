"""The methods of Open3D's `RaycastingScene`. Results are numpy arrays instead of tensors.

Open3D itself is not needed.
"""

from __future__ import annotations

from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

    def __init__(self, nthreads: int = 0) -> None:
        self._threads = _convert.threads(nthreads or None)
        self._meshes: list[Any] = []
        self._scene: RayScene | None = None

    def add_triangles(self, vertices: Any, triangles: ArrayLike | None = None) -> int:
        """Add a mesh: arrays or tensors of vertices and faces, or a mesh of Open3D.

        Returns its id. Raises the exceptions of `RayScene`.
        """
        if triangles is None:
            vertices, triangles = _convert.open3d_arrays(vertices)
        points, faces = _convert.mesh(_convert.array(vertices), _convert.array(triangles))
        check_mesh(points, faces, self._threads)
        self._meshes.append((points.copy(), faces.copy()))
        self._scene = None
        return len(self._meshes) - 1

    @property
    def scene(self) -> RayScene:
        """The `lightpath.RayScene` of all meshes."""
        if self._scene is None:
            self._scene = RayScene.from_meshes(self._meshes, threads=self._threads)
        return self._scene

    def _rays(self, rays, tnear=0.0, tfar=np.inf):
        """Return the scene, the shape of the results, and the arguments of a query."""
        rays = _convert.floats("rays", rays)
        if rays.ndim == 0 or rays.shape[-1] != 6:
            raise ValueError(f"rays: found shape {rays.shape}, expected (..., 6)")
        flat = rays.reshape(-1, 6)
        can_hit = np.isfinite(flat).all(axis=1) & flat[:, 3:].any(axis=1) & bool(self._meshes)
        flat = np.where(can_hit[:, np.newaxis], flat, [0.0, 0, 0, 0, 0, 1])
        scene = self.scene if self._meshes else RayScene(*STAND_IN, threads=1)
        limits = tnear, np.where(can_hit, _convert.unmasked("tfar", tfar), 0.0)
        return scene, rays.shape[:-1], (flat[:, :3], flat[:, 3:], *limits)

    @staticmethod
    def _points(points):
        points = _convert.floats("query_points", points)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise ValueError(f"query_points: found shape {points.shape}, expected (..., 3)")
        return points.shape[:-1], points.reshape(-1, 3)

    @staticmethod
    def _ids(indices):
        """Return indices as uint32: -1 becomes `INVALID_ID`."""
        return indices.astype(np.uint32)

    @overload
    @staticmethod
    def create_rays_pinhole(
        intrinsic_matrix: ArrayLike, extrinsic_matrix: ArrayLike, width_px: int, height_px: int
    ) -> NDArray[Any]: ...
    @overload
    @staticmethod
    def create_rays_pinhole(
        fov_deg: float, center: ArrayLike, eye: ArrayLike, up: ArrayLike, width_px: int,
        height_px: int
    ) -> NDArray[Any]: ...
    @staticmethod
    def create_rays_pinhole(*args: Any, **kwargs: Any) -> NDArray[Any]:
        """Return the rays of a camera, (height_px, width_px, 6) float32.

        The parameters are (intrinsic_matrix, extrinsic_matrix, width_px, height_px), with the 4x4
        matrix from world to camera, or (fov_deg, center, eye, up, width_px, height_px), with the
        horizontal field of view in degrees. As in Open3D, a direction is 1 long along the camera's
        axis, and `up` points to the last row.
        """
        by_matrices = len(args) + len(kwargs) <= 4
        return (_rays_by_matrices if by_matrices else _rays_by_view)(*args, **kwargs)

    def cast_rays(self, rays: ArrayLike, nthreads: int = 0) -> dict[str, NDArray[Any]]:
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

    def test_occlusions(self, rays: ArrayLike, tnear: float = 0.0, tfar: float = np.inf,
                        nthreads: int = 0) -> NDArray[Any]:
        """Return whether each ray hits any face."""
        scene, shape, query = self._rays(rays, tnear, tfar)
        return scene.occluded(*query).reshape(shape)

    def count_intersections(self, rays: ArrayLike, nthreads: int = 0) -> NDArray[Any]:
        """Return the number of hits along each ray."""
        scene, shape, query = self._rays(rays)
        return scene.count(*query).astype(np.int32).reshape(shape)

    def list_intersections(self, rays: ArrayLike, nthreads: int = 0) -> dict[str, NDArray[Any]]:
        """Find all hits along each ray.

        Returns a dict of ray_splits, ray_ids, t_hit, geometry_ids, primitive_ids and
        primitive_uvs. The hits of ray i have the indices ``ray_splits[i]:ray_splits[i + 1]``.
        """
        scene, _, query = self._rays(rays)
        hits = scene.all_hits(*query)
        ray_ids = np.repeat(np.arange(len(query[0]), dtype=np.uint32), np.diff(hits.offsets))
        return {
            "ray_splits": hits.offsets.astype(np.uint32),
            "ray_ids": ray_ids,
            "t_hit": hits.t.astype(np.float32),
            "geometry_ids": self._ids(hits.mesh),
            "primitive_ids": self._ids(hits.primitive),
            "primitive_uvs": hits.barycentrics.astype(np.float32),
        }

    def compute_closest_points(self, query_points: ArrayLike,
                               nthreads: int = 0) -> dict[str, NDArray[Any]]:
        """Return the nearest points.

        Returns a dict of points, geometry_ids, primitive_ids, primitive_uvs and primitive_normals.
        """
        shape, points = self._points(query_points)
        nearest = self.scene.closest_point(points)
        uvs, normals = _place(self._corners(nearest.mesh, nearest.primitive), nearest.point)
        return {
            "points": nearest.point.astype(np.float32).reshape(*shape, 3),
            "geometry_ids": self._ids(nearest.mesh).reshape(shape),
            "primitive_ids": self._ids(nearest.primitive).reshape(shape),
            "primitive_uvs": uvs.astype(np.float32).reshape(*shape, 2),
            "primitive_normals": normals.astype(np.float32).reshape(*shape, 3),
        }

    def _corners(self, meshes, primitives):
        """Return the corners of faces, (3, n, 3) float64."""
        corners = np.empty((3, len(meshes), 3))
        for index, (vertices, faces) in enumerate(self._meshes):
            of_mesh = meshes == index
            corners[:, of_mesh] = np.moveaxis(vertices[faces[primitives[of_mesh]]], 1, 0)
        return corners

    def compute_distance(self, query_points: ArrayLike, nthreads: int = 0) -> NDArray[Any]:
        """Return the distance of each point from the meshes."""
        shape, points = self._points(query_points)
        return self.scene.distance(points).astype(np.float32).reshape(shape)

    def compute_signed_distance(self, query_points: ArrayLike, nthreads: int = 0,
                                nsamples: int = 1) -> NDArray[Any]:
        """Return the distance of each point, negative inside: see `RayScene.contains`."""
        shape, points = self._points(query_points)
        return self.scene.distance(points, signed=True).astype(np.float32).reshape(shape)

    def compute_occupancy(self, query_points: ArrayLike, nthreads: int = 0,
                          nsamples: int = 1) -> NDArray[Any]:
        """Return 1 for points inside, else 0: see `RayScene.contains`."""
        shape, points = self._points(query_points)
        return self.scene.contains(points).astype(np.float32).reshape(shape)


def _rays_by_matrices(intrinsic_matrix, extrinsic_matrix, width_px, height_px):
    intrinsic = _convert.floats("intrinsic_matrix", intrinsic_matrix)
    extrinsic = _convert.floats("extrinsic_matrix", extrinsic_matrix)
    for name, matrix, size in [("intrinsic", intrinsic, 3), ("extrinsic", extrinsic, 4)]:
        if matrix.shape != (size, size):
            expected = f"expected ({size}, {size})"
            raise ValueError(f"{name}_matrix: found shape {matrix.shape}, {expected}")
    rotation = extrinsic[:3, :3].T
    y, x = np.mgrid[:height_px, :width_px] + 0.5
    rays = np.empty((height_px, width_px, 6), dtype=np.float32)
    rays[..., :3] = -rotation @ extrinsic[:3, 3]
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    rays[..., 3:] = pixels @ (rotation @ np.linalg.inv(intrinsic)).T
    return rays


def _rays_by_view(fov_deg, center, eye, up, width_px, height_px):
    vectors = zip(("center", "eye", "up"), (center, eye, up))
    center, eye, up = (_vector(name, value) for name, value in vectors)
    ahead = _unit(center - eye)
    right = _unit(np.cross(up, ahead))
    extrinsic = np.eye(4)
    extrinsic[:3, :3] = right, np.cross(ahead, right), ahead
    extrinsic[:3, 3] = -extrinsic[:3, :3] @ eye
    focal = 0.5 * width_px / np.tan(np.radians(0.5 * fov_deg))
    intrinsic = [[focal, 0.0, 0.5 * width_px], [0.0, focal, 0.5 * height_px], [0.0, 0.0, 1.0]]
    return _rays_by_matrices(intrinsic, extrinsic, width_px, height_px)


def _vector(name, value):
    vector = _convert.floats(name, value)
    if vector.shape != (3,):
        raise ValueError(f"{name}: found shape {vector.shape}, expected (3,)")
    return vector


def _unit(vector):
    length = np.linalg.norm(vector)
    if not length > 0.0:
        raise ValueError("up: found a view without direction, expected eye, center and up not in line")
    return vector / length


def _place(corners, points):
    """Return barycentrics (n, 2) of points on triangles, and unit normals of the triangles.

    The corners are (3, n, 3). A normal is nan for a triangle without area.
    """
    first = corners[0]
    sides, to = corners[1:] - first, points - first
    normals = np.cross(sides[0], sides[1])
    squared = (normals**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (np.cross(to, sides[1]) * normals).sum(axis=1) / squared
        v = (np.cross(sides[0], to) * normals).sum(axis=1) / squared
        normals = normals / np.sqrt(squared)[:, np.newaxis]
        # The point on a triangle without area lies on one of the two sides.
        along = (to * sides).sum(axis=2) / (sides**2).sum(axis=2)
    along = np.nan_to_num(along)
    on_first = (along[0] > 0.0) & (along[0] <= 1.0)
    flat = squared == 0.0
    u = np.where(flat, np.where(on_first, along[0], 0.0), u)
    v = np.where(flat, np.where(on_first, 0.0, along[1]), v)
    return np.clip(np.stack([u, v], axis=1), 0.0, 1.0), normals
