"""Rays for trimesh: a `RayMeshIntersector` with the methods of the classes in `trimesh.ray`.

Examples
--------
    mesh.ray = lightpath.trimesh.RayMeshIntersector(mesh)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _convert
from ._rays import RayScene

# Rays start before their origins, so that an origin on the surface is a hit: by this fraction of
# `mesh.scale`. It exceeds the rounding of an origin to float32.
_START = 2.5e-7


class RayMeshIntersector:
    """Ray queries of a `trimesh.Trimesh`.

    Parameters
    ----------
    geometry : trimesh.Trimesh
        The mesh. If it changes, the next query builds the tree again.
    scale_to_box : bool, optional
        Ignored: precision does not depend on the size of a mesh.

    Notes
    -----
    A ray with a direction of length 0, or with a number that is not finite, hits nothing. Hits at
    the origin of a ray count, as in trimesh's own classes. So do hits up to 2.5e-7 of `mesh.scale`
    before the origin.
    """

    def __init__(self, geometry: Any, scale_to_box: bool = True) -> None:
        self.mesh = geometry
        self._scale_to_box = scale_to_box
        self._built: tuple[int, RayScene] | None = None

    @property
    def scene(self) -> RayScene:
        """The `lightpath.RayScene` of the mesh as it is now."""
        key = hash(self.mesh)
        if self._built is None or self._built[0] != key:
            self._built = key, RayScene.from_trimesh(self.mesh)
        return self._built[1]

    def _rays(self, ray_origins, ray_directions):
        origins = np.array(_convert.unmasked("ray_origins", ray_origins), dtype=np.float64)
        directions = np.array(_convert.unmasked("ray_directions", ray_directions), dtype=np.float64)
        if origins.shape != directions.shape:
            raise ValueError("Ray origin and direction don't match!")
        if origins.size == 0:
            origins = directions = np.empty((0, 3))
        valid = np.isfinite(origins).all(axis=1) & np.isfinite(directions).all(axis=1)
        # Scaled by powers of two, which rounds nothing: squares of very long and very short ones
        # are beyond the range of numbers.
        directions[~valid] = 0.0
        largest = np.abs(directions).max(axis=1)
        directions = np.ldexp(directions, -np.frexp(largest)[1][:, None])
        lengths = np.linalg.norm(directions, axis=1)
        valid &= lengths > 0.0
        origins[~valid], directions[~valid], lengths[~valid] = 0.0, 1.0, 1.0
        directions /= lengths[:, None]
        back = _START * self.mesh.scale
        return origins - back * directions, directions, valid

    def intersects_id(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike, multiple_hits: bool = True,
        max_hits: int = 100, return_locations: bool = False
    ) -> tuple[NDArray[Any], ...]:
        """Find the triangles that rays hit.

        Parameters
        ----------
        ray_origins, ray_directions : (n, 3) float
            The rays.
        multiple_hits : bool
            Whether to return all hits of a ray or only the first.
        max_hits : int
            Maximum number of hits of a ray.
        return_locations : bool
            Whether to return the points of the hits, too.

        Returns
        -------
        index_tri, index_ray : (m,) int
            Indices of faces and rays, sorted by ray, then by distance.
        locations : (m, 3) float
            Only if `return_locations`.
        """
        origins, directions, valid = self._rays(ray_origins, ray_directions)
        if multiple_hits:
            hits = self.scene.all_hits(origins, directions)
            counts = np.diff(hits.offsets)
            index_ray = np.repeat(np.arange(len(counts)), counts)
            rank = np.arange(len(index_ray)) - hits.offsets[index_ray]
            kept = valid[index_ray] & (rank < max_hits)
            index_ray, index_tri, t = index_ray[kept], hits.primitive[kept], hits.t[kept]
        else:
            first = self.scene.closest(origins, directions)
            index_ray = np.nonzero(valid & (first.primitive >= 0))[0]
            index_tri, t = first.primitive[index_ray], first.t[index_ray]
        if not return_locations:
            return index_tri, index_ray
        return index_tri, index_ray, origins[index_ray] + t[:, None] * directions[index_ray]

    def intersects_location(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike, multiple_hits: bool = True
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Find the points where rays hit the surface, at most 100 per ray.

        Returns
        -------
        locations : (m, 3) float
        index_ray, index_tri : (m,) int
        """
        index_tri, index_ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits, return_locations=True
        )
        return locations, index_ray, index_tri

    def intersects_first(self, ray_origins: ArrayLike,
                         ray_directions: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the first triangle that each ray hits; -1 for a miss."""
        origins, directions, valid = self._rays(ray_origins, ray_directions)
        return np.where(valid, self.scene.closest(origins, directions).primitive, -1)

    def intersects_any(self, ray_origins: ArrayLike,
                       ray_directions: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each ray hits the surface."""
        origins, directions, valid = self._rays(ray_origins, ray_directions)
        return valid & self.scene.occluded(origins, directions)

    def contains_points(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point is inside or on the surface: see `RayScene.contains`."""
        points = np.asanyarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError("points must be (n,3)")
        return self.scene.contains(points)

    def __getstate__(self):
        return {"mesh": self.mesh, "_scale_to_box": self._scale_to_box, "_built": None}

    def __setstate__(self, state):
        self.__dict__.update(state)

    def __copy__(self):
        return RayMeshIntersector(self.mesh, self._scale_to_box)

    def __deepcopy__(self, *args):
        return self.__copy__()
