"""Converts arguments to the shapes, dtypes and memory order that `_lightpath` needs."""

import numpy as np

# A call takes fewer rays, points, vertices or faces than this.
MAX_COUNT = 2**32


def unmasked(name, value):
    """Return the value. Raises ValueError for masked values: numpy's conversions ignore masks."""
    if np.ma.is_masked(value):
        raise ValueError(f"{name}: found masked values, expected an array without them")
    return value


def floats(name, value):
    """Return an array, tensor or sequence as an array of float64."""
    return np.asarray(unmasked(name, array(value)), dtype=np.float64)


def _numbers(name, value, kinds, expected):
    """Return the value as an array of one of the dtype kinds. An empty array may have any dtype."""
    unmasked(name, value)
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if array.dtype.kind not in kinds and array.size > 0:
        raise TypeError(f"{name}: found dtype {array.dtype}, expected {expected}")
    return array


def points(name, value):
    """Return an (n, 3) array of float64 in C order. A single point becomes one row."""
    array = _numbers(name, value, "fiu", "real numbers")
    if array.shape == (3,):
        array = array[np.newaxis]
    if array.shape == (0,):
        array = np.empty((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: found shape {array.shape}, expected (n, 3)")
    if array.shape[0] >= MAX_COUNT:
        raise ValueError(f"{name}: found {array.shape[0]} rows, expected fewer than 2**32")
    return _native(array, np.float64)


def limits(name, value, count):
    """Return an array of 1 or `count` float64."""
    array = _numbers(name, value, "fiu", "real numbers")
    if array.ndim == 0:
        array = array[np.newaxis]
    if array.ndim != 1 or array.shape[0] not in (1, count):
        raise ValueError(f"{name}: found shape {array.shape}, expected a number or ({count},)")
    return _native(array, np.float64)


def rays(origins, directions, tnear, tfar):
    """Return origins, directions, tnear, tfar. A single origin or direction is repeated for all."""
    origins, directions = points("origins", origins), points("directions", directions)
    if len(origins) == 1 and len(directions) != 1:
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape))
    elif len(directions) == 1 and len(origins) != 1:
        directions = np.ascontiguousarray(np.broadcast_to(directions, origins.shape))
    if len(origins) != len(directions):
        raise ValueError(f"directions: found shape {directions.shape}, expected {origins.shape}")
    count = len(origins)
    return origins, directions, limits("tnear", tnear, count), limits("tfar", tfar, count)


def _native(array, dtype):
    """Return the array with this dtype, aligned and in C order. Copies only if it must."""
    return np.require(array, dtype=dtype, requirements=["C", "A"])


def mesh(vertices, faces):
    """Return vertices as float32 or float64, faces as 32-bit or 64-bit integers, in C order."""
    vertices = _numbers("vertices", vertices, "fiu", "real numbers")
    faces = _numbers("faces", faces, "iu", "integers")
    for name, array in (("vertices", vertices), ("faces", faces)):
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"{name}: found shape {array.shape}, expected (n, 3)")
        if array.shape[0] >= MAX_COUNT:
            raise ValueError(f"{name}: found {array.shape[0]} rows, expected fewer than 2**32")
    single = vertices.dtype.kind == "f" and vertices.dtype.itemsize <= 4
    vertices = _native(vertices, np.float32 if single else np.float64)
    # An empty array may have a dtype that no integer has.
    kept = np.dtype(faces.dtype.kind + str(max(faces.dtype.itemsize, 4))) if faces.size else np.int64
    return vertices, _native(faces, kept)


def wrong_type(name, source, expected):
    """Return the exception for an object that is no mesh."""
    found = f"{name}: found {type(source).__name__}, expected {expected}"
    # A scene of trimesh holds meshes.
    help = "; take scene.to_geometry()" if hasattr(source, "geometry") else ""
    return TypeError(found + help)


def trimesh_arrays(source):
    """Return the vertices and faces of a `trimesh.Trimesh`."""
    if not (hasattr(source, "vertices") and hasattr(source, "faces")):
        raise wrong_type("mesh", source, "a trimesh.Trimesh")
    vertices, faces = unmasked("vertices", source.vertices), unmasked("faces", source.faces)
    return vertices.view(np.ndarray), faces.view(np.ndarray)


def open3d_arrays(source):
    """Return the vertices and faces of an Open3D triangle mesh, legacy or tensor-based."""
    if hasattr(source, "vertices") and hasattr(source, "triangles"):
        return np.asarray(source.vertices), np.asarray(source.triangles)
    if hasattr(source, "vertex") and hasattr(source, "triangle"):
        return source.vertex.positions.numpy(), source.triangle.indices.numpy()
    raise wrong_type("mesh", source, "a triangle mesh of Open3D")


def _parts(source, name):
    """Return an attribute that is a collection; an empty one if it is None or missing."""
    value = getattr(source, name, None)
    return () if value is None else value


def _vertex_colors(source):
    """Return the colours of vertices of a mesh of trimesh or Open3D, or None."""
    if getattr(getattr(source, "visual", None), "kind", None) == "vertex":
        return source.visual.vertex_colors
    if len(_parts(source, "vertex_colors")) > 0:
        return source.vertex_colors
    if "colors" in _parts(source, "vertex"):
        return source.vertex.colors.numpy()
    return None


def colors(source, count):
    """Return the colours of a mesh of trimesh or Open3D: (count, 4) uint8 or uint16, or None.

    They are sRGB-encoded, in fractions of the dtype's maximum. The last column is alpha.
    """
    found = _vertex_colors(source)
    if found is None:
        return None
    found = np.asarray(unmasked("colors", found))
    found = found.astype(found.dtype.newbyteorder("="), copy=False)
    if found.dtype.kind == "f":
        found = np.round(np.clip(np.nan_to_num(found), 0.0, 1.0) * 65535).astype(np.uint16)
    if found.dtype.kind in "iu" and found.dtype != np.uint16:
        if found.size > 0 and not 0 <= found.min() <= found.max() <= 255:
            raise ValueError(f"colors: found {found.min()} to {found.max()}, expected 0 to 255")
        found = found.astype(np.uint8)
    if found.dtype not in (np.uint8, np.uint16) or found.shape not in ((count, 3), (count, 4)):
        expected = f"({count}, 3) or ({count}, 4) of integers or floats"
        raise ValueError(f"colors: found {found.shape} of {found.dtype}, expected {expected}")
    opaque = np.full((count, 4 - found.shape[1]), np.iinfo(found.dtype).max, dtype=found.dtype)
    return np.ascontiguousarray(np.concatenate([found, opaque], axis=1))


def left_out(source):
    """Return warnings about what a picture of a mesh of trimesh or Open3D does not show."""
    kind = getattr(getattr(source, "visual", None), "kind", None)
    lost = {"face": "the colours of faces", "texture": "texture and material"}.get(kind)
    in_triangles = {"colors", "texture_uvs"} & set(_parts(source, "triangle"))
    if len(_parts(source, "triangle_uvs")) > 0 or in_triangles:
        lost = "colours of triangles and textures"
    return [f"mesh: {lost} are not shown; help: write it to PLY"] if lost else []


def array(value):
    """Return the numpy array of a tensor; any other value as it is."""
    return value.numpy() if hasattr(value, "numpy") else value


def threads(value):
    """Return a number of threads, or None for all processors."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"threads: found {value!r}, expected an integer or None")
    if not 1 <= value <= 1024:
        raise ValueError(f"threads: found {value}, expected 1 to 1024")
    return int(value)
