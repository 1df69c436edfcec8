"""Queries about meshes: `RayScene` and the tuples that it returns."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _convert, _pictures
from ._lightpath import Scene, read_mesh

Progress = Callable[[int, int], object]
Backend = Literal["bvh", "embree"]


class Hits(NamedTuple):
    """The closest hits of n rays.

    Attributes
    ----------
    t : (n,) float64
        Ray parameter, in units of the direction; inf for a miss.
    primitive : (n,) int64
        Index of the face in its mesh; -1 for a miss.
    mesh : (n,) int32
        Index of the mesh; -1 for a miss.
    barycentrics : (n, 2) float64
        Weights of the second and third corner, in [0, 1]; nan for a miss.
    normal : (n, 3) float64
        Unit normal ``(v1 - v0) x (v2 - v0)`` of the face; 0 for a miss, nan for a face without
        area.
    """

    t: NDArray[np.float64]
    primitive: NDArray[np.int64]
    mesh: NDArray[np.int32]
    barycentrics: NDArray[np.float64]
    normal: NDArray[np.float64]


class AllHits(NamedTuple):
    """All m hits along n rays, sorted by ray, then by t.

    The hits of ray i have the indices ``offsets[i]:offsets[i + 1]`` in all arrays.

    Attributes
    ----------
    offsets : (n + 1,) int64
        Index of the first hit of each ray, then the number of all hits.
    t : (m,) float64
        Ray parameter, in units of the direction.
    primitive : (m,) int64
        Index of the face in its mesh.
    mesh : (m,) int32
        Index of the mesh.
    barycentrics : (m, 2) float64
        Weights of the second and third corner, in [0, 1].
    """

    offsets: NDArray[np.int64]
    t: NDArray[np.float64]
    primitive: NDArray[np.int64]
    mesh: NDArray[np.int32]
    barycentrics: NDArray[np.float64]


class ClosestPoints(NamedTuple):
    """The points of the meshes that are nearest to n points.

    Attributes
    ----------
    point : (n, 3) float64
        The nearest point on all faces.
    distance : (n,) float64
        Distance to it, >= 0, in units of the meshes.
    primitive : (n,) int64
        Index of its face in its mesh.
    mesh : (n,) int32
        Index of the mesh.
    """

    point: NDArray[np.float64]
    distance: NDArray[np.float64]
    primitive: NDArray[np.int64]
    mesh: NDArray[np.int32]


class RayScene:
    """Triangle meshes with an acceleration structure, for queries with rays and points.

    Parameters
    ----------
    vertices : (v, 3) array_like of float32 or float64
        Positions. Arrays in C order and native byte order are not copied: they must not change
        while the scene is used.
    faces : (f, 3) array_like of int
        Indices of vertices. Not copied either, if they have 32 or 64 bits.
    threads : int, optional
        Number of threads of the build and of all queries. By default one per processor.
    backend : {"bvh", "embree"}, optional
        What traces the rays. ``"embree"`` loads an Embree 4 of the system and answers only
        `closest` and `occluded`.
    progress : callable, optional
        Called with (done, total) every 50 ms during the build, and once at its end.

    Raises
    ------
    ValueError
        A wrong shape; an index out of range; no face; a vertex of a face that is not finite or
        beyond 1e18. The message names the place. `lightpath.Error` is a ValueError. Also raised if
        there is no Embree 4, and by all other queries if the backend is ``"embree"``.
    TypeError
        Vertices that are not real numbers, or faces that are not integers.
    MemoryError
        Too little memory.

    Notes
    -----
    To find a hit, rays and vertices are rounded to float32, relative to the middle of the meshes
    (or to 0, if 0 is near). The search is exact for the rounded values: no ray slips through an
    edge or a vertex. The values of a hit are computed in float64 from the original arrays.

    With ``backend="embree"`` the search is not exact. A ray that passes an edge within the rounding
    of float32 may hit the wrong side of it, and a ray aimed exactly at a vertex can slip through.

    The GIL is released. Ctrl-C stops a long build or query.

    A scene can be pickled: the arrays are stored. Unpickling builds the tree again.

    Examples
    --------
    >>> import lightpath
    >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> scene
    RayScene(1 mesh, 1 face)
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, *, threads: int | None = None,
                 backend: Backend = "bvh", progress: Progress | None = None) -> None:
        self._build([_convert.mesh(vertices, faces)], threads, backend, progress)

    def _build(self, meshes, threads, backend, progress=None):
        if not isinstance(backend, str):
            raise TypeError(f"backend: found {backend!r}, expected a string")
        self._meshes = meshes
        self._threads = _convert.threads(threads)
        self._backend = backend
        self._scene = Scene(meshes, self._threads, backend, progress)

    @classmethod
    def from_meshes(cls, meshes: Iterable[tuple[ArrayLike, ArrayLike]], *,
                    threads: int | None = None, backend: Backend = "bvh",
                    progress: Progress | None = None) -> RayScene:
        """Make a scene of several meshes.

        Parameters
        ----------
        meshes : sequence of (vertices, faces)
            Arrays as for `RayScene`. The index in the sequence is the `mesh` of a hit.
        threads, backend, progress
            As for `RayScene`.

        Examples
        --------
        >>> import numpy as np, lightpath
        >>> corners, faces = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
        >>> scene = lightpath.RayScene.from_meshes([(corners, faces), (corners + 5, faces)])
        >>> scene.closest([[5.2, 5.2, 9]], [[0, 0, -1]]).mesh
        array([1], dtype=int32)
        """
        scene = cls.__new__(cls)
        converted = []
        for index, pair in enumerate(meshes):
            try:
                vertices, faces = pair
            except (TypeError, ValueError):
                raise ValueError(f"mesh {index}: expected a pair: vertices, faces") from None
            try:
                converted.append(_convert.mesh(vertices, faces))
            except (TypeError, ValueError) as error:
                raise type(error)(f"mesh {index}: {error}") from None
        scene._build(converted, threads, backend, progress)
        return scene

    @classmethod
    def from_ply(cls, path: str | os.PathLike[str], *, threads: int | None = None,
                 backend: Backend = "bvh", progress: Progress | None = None) -> RayScene:
        """Make a scene of a PLY file, plain or compressed with gzip or zstd.

        Parameters
        ----------
        path : str or path-like
            The file.
        threads, backend, progress
            As for `RayScene`.

        Notes
        -----
        Faces that repeat a point or an earlier face are dropped. Faces without area that close
        T-junctions come last. ``scene.meshes[0]`` has the arrays that `primitive` counts in.
        """
        if not isinstance(path, (str, os.PathLike)):
            raise TypeError(f"path: found {type(path).__name__}, expected a string or a path")
        arrays = read_mesh(path, _convert.threads(threads))
        return cls(*arrays, threads=threads, backend=backend, progress=progress)

    @classmethod
    def from_trimesh(cls, mesh: Any, *, threads: int | None = None,
                     backend: Backend = "bvh", progress: Progress | None = None) -> RayScene:
        """Make a scene of a `trimesh.Trimesh`."""
        return cls(*_convert.trimesh_arrays(mesh), threads=threads, backend=backend,
                   progress=progress)

    @classmethod
    def from_open3d(cls, mesh: Any, *, threads: int | None = None,
                    backend: Backend = "bvh", progress: Progress | None = None) -> RayScene:
        """Make a scene of an Open3D triangle mesh, legacy or tensor-based."""
        return cls(*_convert.open3d_arrays(mesh), threads=threads, backend=backend,
                   progress=progress)

    def __reduce__(self):
        own = "_meshes", "_threads", "_backend", "_scene"
        added = {name: value for name, value in vars(self).items() if name not in own}
        arguments = self._meshes, self._threads, self._backend, type(self)
        return _unpickle, arguments, added or None

    def __repr__(self):
        meshes, faces = len(self._meshes), self.num_faces
        plural = "" if meshes == 1 else "es", "" if faces == 1 else "s"
        return f"RayScene({meshes} mesh{plural[0]}, {faces} face{plural[1]})"

    def _repr_png_(self):
        return _pictures.thumbnail(self)

    @property
    def meshes(self) -> list[tuple[NDArray[Any], NDArray[Any]]]:
        """List of the (vertices, faces) of the meshes: the arrays that the scene uses."""
        return list(self._meshes)

    @property
    def backend(self) -> Backend:
        """What traces the rays: ``"bvh"`` or ``"embree"``."""
        return self._backend

    @property
    def num_faces(self) -> int:
        """Number of faces of all meshes."""
        return sum(len(faces) for _, faces in self._meshes)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) float64: lower and upper corner of the box around all faces."""
        return np.array(self._scene.bounds)

    @property
    def nbytes(self) -> int:
        """Number of bytes that the scene holds, without the arrays of its meshes."""
        return self._scene.bytes[0]

    @property
    def is_closed(self) -> list[bool]:
        """List of bool: for each mesh, whether an even number of faces shares every edge.

        Vertices with equal coordinates count as one vertex.
        """
        return self._scene.closed()

    def closest(self, origins: ArrayLike, directions: ArrayLike, tnear: ArrayLike = 0.0,
                tfar: ArrayLike = np.inf, *, progress: Progress | None = None) -> Hits:
        """Find the closest hit of each ray.

        Parameters
        ----------
        origins, directions : (n, 3) or (3,) array_like
            Rays ``origin + t * direction``. Directions may have any length but 0. A single origin
            or direction is used for all rays.
        tnear, tfar : float or (n,) array_like
            Only hits with ``tnear < t < tfar`` count. Both must be >= 0. t is compared in float64,
            so ``tnear=hits.t`` excludes the hits of an earlier query. A tnear of 0 excludes no hit,
            not even one of t = 0; a tnear of inf excludes all.
        progress : callable, optional
            Called with (done, total) every 50 ms, and once at the end.

        Returns
        -------
        Hits
            Of hits of equal t, that of the lowest mesh and then the lowest face, if the backend is
            ``"bvh"``. Layers that float32 cannot tell apart are one hit; `all_hits` tells them
            apart.

        Raises
        ------
        ValueError, TypeError
            Wrong shapes or dtypes; numbers that are not finite (limits may be inf); an origin beyond
            1e18; a direction of length 0; a negative tnear or tfar; 2**32 rays or more.

        Examples
        --------
        >>> import lightpath
        >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> hits = scene.closest([[0.25, 0.5, 2], [3, 3, 3]], [0, 0, -1])
        >>> hits.t, hits.primitive
        (array([ 2., inf]), array([ 0, -1]))
        >>> hits.barycentrics[0]
        array([0.25, 0.5 ])
        """
        return Hits(*self._scene.closest(_convert.rays(origins, directions, tnear, tfar), progress))

    def occluded(self, origins: ArrayLike, directions: ArrayLike, tnear: ArrayLike = 0.0,
                 tfar: ArrayLike = np.inf, *,
                 progress: Progress | None = None) -> NDArray[np.bool_]:
        """Return whether each ray hits any face. Faster than `closest`.

        Parameters and exceptions are those of `closest`.

        Returns
        -------
        (n,) bool

        Examples
        --------
        >>> import lightpath
        >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> scene.occluded([0.2, 0.2, 2], [[0, 0, -1], [0, 0, 1]])
        array([ True, False])
        """
        return self._scene.occluded(_convert.rays(origins, directions, tnear, tfar), progress)

    def count(self, origins: ArrayLike, directions: ArrayLike, tnear: ArrayLike = 0.0,
              tfar: ArrayLike = np.inf, *, progress: Progress | None = None) -> NDArray[np.uint32]:
        """Return the number of hits along each ray, counted as in `all_hits`.

        Parameters and exceptions are those of `closest`.

        Returns
        -------
        (n,) uint32

        Examples
        --------
        >>> import lightpath
        >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> scene.count([0.2, 0.2, 2], [0, 0, -1])
        array([1], dtype=uint32)
        """
        return self._scene.count(_convert.rays(origins, directions, tnear, tfar), progress)

    def all_hits(self, origins: ArrayLike, directions: ArrayLike, tnear: ArrayLike = 0.0,
                 tfar: ArrayLike = np.inf, *, progress: Progress | None = None) -> AllHits:
        """Find all hits along each ray.

        Parameters and exceptions are those of `closest`.

        Returns
        -------
        AllHits

        Notes
        -----
        Where a ray crosses the surface at an edge or a vertex, there is one hit, on one of the
        faces there. Where it only touches the surface at an edge or a vertex, there are no hits, or
        two with the same t. A face that is parallel to the ray has no hits, but its neighbours may.
        So a ray from outside hits a closed mesh an even number of times.

        Examples
        --------
        The ray enters through a vertex of a tetrahedron, which belongs to three faces.

        >>> import lightpath
        >>> corners = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1]]
        >>> scene = lightpath.RayScene(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> hits = scene.all_hits([0.2, 0.2, 2], [0, 0, -1])
        >>> hits.offsets, hits.t
        (array([0, 2]), array([1., 2.]))
        """
        rays = _convert.rays(origins, directions, tnear, tfar)
        return AllHits(*self._scene.all_hits(rays, progress))

    def contains(self, points: ArrayLike, *, progress: Progress | None = None) -> NDArray[np.bool_]:
        """Return whether each point lies inside a mesh or on its surface.

        Parameters
        ----------
        points : (n, 3) or (3,) array_like
            Points in the coordinates of the meshes.
        progress : callable, optional
            Called with (done, total) every 50 ms.

        Returns
        -------
        (n,) bool

        Raises
        ------
        ValueError, TypeError
            Wrong shapes or dtypes; numbers that are not finite or beyond 1e18; 2**32 points or more.

        Notes
        -----
        For closed meshes (`is_closed`) the result is exact: the crossings of a half-line are
        counted without rounding. A point on a vertex, edge or face is inside. A solid that is there
        twice has nothing inside. Meshes that are not closed are taken together: a point is inside
        if the absolute value of their winding number is at least 1/2.

        Examples
        --------
        >>> import lightpath
        >>> corners = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> scene = lightpath.RayScene(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> scene.contains([[0.1, 0.1, 0.1], [0, 0, 0], [0, 0, -1e-300]])
        array([ True,  True, False])
        """
        return self._scene.contains(_convert.points("points", points), progress)

    def winding_number(self, points: ArrayLike, *,
                       progress: Progress | None = None) -> NDArray[np.float64]:
        """Return the winding number of each point in all meshes together.

        It is 1 inside a closed mesh whose normals point outward, and 0 outside. Near the holes of
        an open mesh, it is between 0 and 1. The error is at most some 0.005 for each surface near
        the point: errors of surfaces in each other add up. Parameters and exceptions are those of
        `contains`.

        Returns
        -------
        (n,) float64

        Examples
        --------
        >>> import lightpath
        >>> corners = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> scene = lightpath.RayScene(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> scene.winding_number([[0.1, 0.1, 0.1], [2, 2, 2]]).round(2)
        array([1., 0.])
        """
        return self._scene.winding_number(_convert.points("points", points), progress)

    def closest_point(self, points: ArrayLike, *,
                      progress: Progress | None = None) -> ClosestPoints:
        """Find the nearest point of the meshes to each point.

        Parameters and exceptions are those of `contains`.

        Returns
        -------
        ClosestPoints
            Of faces whose rounded distances are equal, that of the lowest mesh, then the lowest
            face wins.

        Examples
        --------
        >>> import lightpath
        >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> scene.closest_point([0.25, 0.25, 3]).point
        array([[0.25, 0.25, 0.  ]])
        """
        return ClosestPoints(*self._scene.closest_point(_convert.points("points", points), progress))

    def distance(self, points: ArrayLike, *, signed: bool = False,
                 progress: Progress | None = None) -> NDArray[np.float64]:
        """Return the distance of each point from the meshes.

        Exceptions are those of `contains`.

        Parameters
        ----------
        points : (n, 3) or (3,) array_like
            Points in the coordinates of the meshes.
        signed : bool, optional
            Whether points inside (`contains`) get a negative distance.
        progress : callable, optional
            Called with (done, total) every 50 ms.

        Returns
        -------
        (n,) float64

        Examples
        --------
        >>> import lightpath
        >>> corners = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> scene = lightpath.RayScene(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> scene.distance([[0.125, 0.25, 0.25], [0.125, 0.25, -2]], signed=True)
        array([-0.125,  2.   ])
        """
        points = _convert.points("points", points)
        if not signed:
            return self._scene.closest_point(points, progress)[1]
        distance = self._scene.closest_point(points, _half(progress, 0))[1]
        inside = self._scene.contains(points, _half(progress, 1))
        # Not -0.0 on the surface.
        distance[inside] = 0.0 - distance[inside]
        return distance

    def visible(self, points: ArrayLike, from_: ArrayLike, *,
                progress: Progress | None = None) -> NDArray[np.bool_]:
        """Return whether each point is visible from another point.

        Exceptions are those of `contains`.

        Parameters
        ----------
        points : (n, 3) or (3,) array_like
            Points, often vertices of a mesh.
        from_ : (3,) or (n, 3) array_like
            The other points: one for all `points`, or one for each.
        progress : callable, optional
            Called with (done, total) every 50 ms.

        Returns
        -------
        (n,) bool

        Notes
        -----
        The result is exact for coordinates that are 0 or at least 1e-70, and points at least 1e-38
        apart; nearer ones always see each other. A face blocks the segment between two points if
        the segment passes through the face, its edges and vertices included. A face whose plane
        contains one of the two points does not block it. So points of a surface do not hide
        themselves.

        Examples
        --------
        >>> import lightpath
        >>> scene = lightpath.RayScene([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> scene.visible([[0.2, 0.2, -1], [0.2, 0.2, 0], [2, 2, -1]], [0.2, 0.2, 5])
        array([False,  True,  True])
        """
        points, from_ = _convert.points("points", points), _convert.points("from_", from_)
        return self._scene.visible(points, from_, progress)


def _half(progress, index):
    """Return the callback of the first or the second of two parts of equal size."""
    return progress and (lambda done, total: progress(index * total + done, 2 * total))


def _unpickle(meshes, threads, backend="bvh", kind=RayScene):
    return kind.from_meshes(meshes, threads=threads, backend=backend)
