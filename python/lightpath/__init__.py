"""Exact rays and pictures on numpy arrays.

`RayScene` answers queries about triangle meshes: closest hits, occlusion, all hits along rays,
points inside or outside, distances and visibility. `render` makes pictures.

Examples
--------
>>> import numpy as np, lightpath
>>> vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
>>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
>>> scene = lightpath.RayScene(vertices, faces)
>>> hits = scene.closest([[0.25, 0.25, 5.0]], [[0.0, 0.0, -1.0]])
>>> hits.t, hits.primitive
(array([4.5]), array([3]))
>>> scene.contains([[0.1, 0.1, 0.1], [1.0, 1.0, 1.0]])
array([ True, False])
"""

from . import open3d, trimesh
from ._errors import FileError, MissingFileError
from ._lightpath import Error, __version__
from ._pictures import Picture, render, render_views
from ._rays import AllHits, ClosestPoints, Hits, RayScene

__all__ = [
    "AllHits",
    "ClosestPoints",
    "Error",
    "FileError",
    "Hits",
    "MissingFileError",
    "Picture",
    "RayScene",
    "__version__",
    "render",
    "render_views",
]
