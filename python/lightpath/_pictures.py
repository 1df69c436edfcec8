"""Pictures of scenes, meshes and files."""

from __future__ import annotations

import contextlib
import copy
import errno
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _convert, _lightpath
from ._errors import cannot_write


class Picture(dict[str, NDArray[Any]]):
    """The layers of a picture, by name.

    ``picture["RGBA"]`` is (height, width, 4) float32: linear BT.709 radiance, premultiplied by
    alpha. Other layers that the scene selects are (height, width) or (height, width, channels), of
    float32 or uint32. A notebook displays the PNG.

    The arrays are read-only: files hold the picture as it was rendered. Copy an array to change it.
    A pickle holds the arrays and the warnings. The picture of a pickle writes no files.

    Attributes
    ----------
    warnings : list of str
        Problems of the scene that did not prevent the render, and what written files do not hold.
    """

    warnings: list[str]

    def __init__(self, picture):
        self._picture = picture
        self.warnings = picture.warnings
        height, width = picture.size
        super().__init__(RGBA=picture.pixels().reshape(height, width, 4))
        channels = picture.channels
        if channels:
            self._split(picture.words().reshape(height, width, len(channels)), channels)
        for array in self.values():
            array.flags.writeable = False

    def _split(self, words, channels):
        """Add the layers, whose channels are interleaved in `words`."""
        groups = {}
        for index, (name, is_integer) in enumerate(channels):
            layer = name.rpartition(".")[0] or name
            groups.setdefault((layer, is_integer), []).append(index)
        for (layer, is_integer), indices in groups.items():
            plane = np.ascontiguousarray(words[:, :, indices])
            plane = plane if is_integer else plane.view(np.float32)
            self[layer] = plane[:, :, 0] if len(indices) == 1 else plane

    def __copy__(self):
        return _restored(dict(self), self.warnings, self._picture)

    def __deepcopy__(self, memo):
        read_only = self._read_only()
        layers = {name: layer if name in read_only else copy.deepcopy(layer, memo)
                  for name, layer in self.items()}
        return _restored(layers, list(self.warnings), self._picture)

    def __reduce__(self):
        return _restored, (dict(self), self.warnings, None, self._read_only())

    def _read_only(self):
        """Return the names of the arrays that cannot change: of all but those that a user added."""
        return [name for name, layer in self.items()
                if isinstance(layer, np.ndarray) and not layer.flags.writeable]

    def write(self, prefix: str | os.PathLike[str], *, float: bool = False) -> list[Path]:
        """Write PREFIX.exr and PREFIX.png, and return their paths.

        An ending .exr or .png of the prefix is dropped. `warnings` tells of values that the EXR does
        not hold, and of a legend for which the PNG is too small.

        Parameters
        ----------
        prefix : str or path-like
            Path of the files without their endings.
        float : bool, optional
            Whether the EXR holds 32-bit floats instead of 16-bit floats, which end at 65504.
        """
        written = self._write(prefix, float)
        for _, warnings in written:
            self._add_warnings(warnings)
        return [path for path, _ in written]

    def _add_warnings(self, warnings):
        self.warnings += [text for text in warnings if text not in self.warnings]

    def _write(self, prefix, float=False):
        """Write the EXR and the PNG, and return the path and the warnings of each."""
        if self._picture is None:
            raise ValueError("found the picture of a pickle, which has only arrays: write its files "
                             "where it was rendered")
        prefix = os.fspath(prefix)
        if not os.path.basename(prefix) or os.path.isdir(prefix):
            raise ValueError(f"prefix: found the folder {prefix!r}, expected a name of files")
        start, end = os.path.splitext(prefix)
        prefix = start if end.lower() in (".exr", ".png") else prefix
        written = self._picture.write(prefix, bool(float))
        return [(Path(path), warnings) for path, warnings in written]

    def write_exr(self, path: str | os.PathLike[str], *, float: bool = False) -> None:
        """Write an EXR with all layers. The file appears only when it is complete.

        Parameters
        ----------
        path : str or path-like
            Name of the file, with its ending .exr.
        float : bool, optional
            As for `write`.
        """
        self._write_one(path, 0, ".exr", float)

    def write_png(self, path: str | os.PathLike[str]) -> None:
        """Write a tone-mapped PNG. The file appears only when it is complete.

        `warnings` tells of a legend for which it is too small.
        """
        self._write_one(path, 1, ".png")

    def _write_one(self, path, which, ending, float=False):
        """Write one of the two files, and add its warnings."""
        path = Path(path)
        if path.suffix.lower() != ending:
            raise ValueError(f"path: found {str(path)!r}, expected a name with the ending {ending}")
        if not path.parent.is_dir():
            raise cannot_write(path, errno.ENOENT, f"there is no folder {path.parent}")
        try:
            with tempfile.TemporaryDirectory(dir=path.parent, prefix=".lightpath-") as folder:
                written, warnings = self._write(Path(folder) / "picture", float)[which]
                os.replace(written, path)
        except OSError as error:  # its message names the hidden folder
            reason = os.strerror(error.errno) if error.errno else error
            raise cannot_write(path, error.errno, reason) from None
        self._add_warnings(warnings)

    def _repr_png_(self):
        if self._picture is None:
            return None
        with tempfile.TemporaryDirectory() as folder:
            _, (png, _) = self._write(Path(folder) / "picture")
            return png.read_bytes()


def _restored(layers, warnings, picture=None, read_only=()):
    """Return a picture of arrays. Without a picture of the native module it writes no files."""
    restored = Picture.__new__(Picture)
    restored.update(layers)
    restored.warnings, restored._picture = warnings, picture
    for name in read_only:  # a pickle does not hold this
        restored[name].flags.writeable = False
    return restored


def render(
    scene: Any,
    *,
    meshes: Mapping[str, tuple[str, ArrayLike, ArrayLike]] | None = None,
    camera: Mapping[str, Any] | None = None,
    spp: int | None = None,
    layers: str | Sequence[str] | None = None,
    backend: str | None = None,
    settings: Mapping[str, Any] | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Picture:
    """Render a picture.

    Parameters
    ----------
    scene : str, path-like, dict, RayScene, (vertices, faces), or a mesh of trimesh or Open3D
        A scene: a file (.json), or a dict with the members of the scene format. Or a mesh or mesh
        file (.ply), which is shown in the built-in studio. Faces that repeat a vertex are left out.
        Colours of vertices of trimesh and Open3D are shown; a RayScene has none. `warnings` tells of
        other colours and textures, which are left out, as are normals: write such a mesh to PLY.
    meshes : dict, optional
        Meshes in world space for a scene as a dict: name -> (material, vertices, faces).
    camera : dict, optional
        Members of ``/camera`` to set, e.g. ``{"width": 640, "fov": 30}``.
    spp : int, optional
        Samples per pixel.
    layers : str or list of str, optional
        Layers of the picture in addition to RGBA, e.g. ``["Z", "N"]``.
    backend : str, optional
        ``"bvh"`` or ``"embree"``, which needs an Embree 4 on the system.
    settings : dict, optional
        Other values of the scene by JSON pointer, e.g. ``{"/nbounces": 4}``.
    threads : int, optional
        Number of threads; by default one per processor.
    progress : callable, optional
        Called with (done, total) every 50 ms, and once at the end. Their unit depends on the phase.

    Returns
    -------
    Picture
        A dict of arrays by layer.

    Raises
    ------
    lightpath.Error
        An invalid scene. The message and the attribute `problems` list all problems.
        `lightpath.Error` is a ValueError. For files that are missing or cannot be read it is also a
        FileNotFoundError or OSError.

    Examples
    --------
    >>> import lightpath
    >>> corners = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> picture = lightpath.render((corners, faces), camera={"width": 48, "height": 32}, spp=1)
    >>> picture["RGBA"].shape
    (32, 48, 4)
    """
    with contextlib.closing(_Views(scene, meshes, threads)) as views:
        return views.render(camera, spp, layers, backend, settings, progress)


def render_views(
    scene: Any,
    cameras: Iterable[Mapping[str, Any]],
    *,
    meshes: Mapping[str, tuple[str, ArrayLike, ArrayLike]] | None = None,
    threads: int | None = None,
    **options: Any,
) -> Iterator[Picture]:
    """Render one picture for each camera, one after the other.

    Each is the picture that `render` returns. The scene is loaded and its tree is built for the
    first one, and kept for the next. Both are made again for a camera that moves the origin of
    float32, or whose `up` places a mesh in the studio anew. Without a `position`, such a mesh is
    read again, to be framed. Arrays must not change before the generator ends.

    Parameters
    ----------
    scene
        As for `render`.
    cameras : iterable of dict
        For each picture, the `camera` of `render`.
    meshes, threads
        As for `render`.
    **options
        Other parameters of `render`.

    Yields
    ------
    Picture

    Examples
    --------
    >>> import lightpath
    >>> mesh = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    >>> sizes = ({"width": w, "height": 8} for w in (8, 16))
    >>> [view["RGBA"].shape for view in lightpath.render_views(mesh, sizes, spp=1)]
    [(8, 8, 4), (8, 16, 4)]
    """
    with contextlib.closing(_Views(scene, meshes, threads)) as views:
        for camera in cameras:
            yield views.render(camera, **options)


class _Views:
    """A scene or mesh for any number of cameras."""

    def __init__(self, scene, meshes, threads):
        self._left_out = _convert.left_out(scene)
        self._views = _lightpath.Views(_subject(scene, meshes), _convert.threads(threads))

    def render(self, camera, spp=None, layers=None, backend=None, settings=None, progress=None):
        """Return the picture of one camera."""
        words = _overrides(camera, spp, layers, backend, settings)
        picture = Picture(self._views.render(words, progress))
        picture.warnings += self._left_out
        return picture

    def close(self):
        """Free the memory, even if the traceback of an exception keeps this object."""
        self._views = None


def _overrides(camera, spp, layers, backend, settings):
    """Return the values of the scene to set, as texts /json/pointer=VALUE."""
    overrides = {}
    for key, value in (camera or {}).items():
        if "=" in str(key):
            raise ValueError(f"camera: found {key!r}, expected a key without `=`")
        overrides[f"/camera/{key}"] = value
    if spp is not None:
        overrides["/spp"] = spp
    if layers is not None:
        overrides["/output/layers"] = [layers] if isinstance(layers, str) else list(layers)
    if backend is not None:
        overrides["/scene/accelerator"] = backend
    overrides.update(settings or {})
    for pointer in overrides:
        if "=" in pointer:
            raise ValueError(f"settings: found {pointer!r}, expected a JSON pointer without `=`")
    return [f"{pointer}={json.dumps(_plain(value))}" for pointer, value in overrides.items()]


def thumbnail(scene: Any) -> bytes:
    """Return the PNG of a small picture of a mesh in the studio."""
    return render(scene, camera={"width": 320, "height": 240}, spp=4)._repr_png_()


def _subject(scene, meshes):
    """Return the subject of `_lightpath.Views`.

    That is (text, meshes), (vertices, faces, colors or None) or a path.
    """
    if isinstance(scene, dict):
        ready = []
        for name, (material, vertices, faces) in (meshes or {}).items():
            ready.append((str(name), str(material), *_convert.mesh(vertices, faces)))
        return json.dumps(_plain(scene)), ready
    if meshes is not None:
        raise ValueError("meshes: expected only with a scene as a dict")
    if isinstance(scene, (str, os.PathLike)):
        return Path(scene)
    if isinstance(scene, tuple):
        if len(scene) != 2:
            raise ValueError(f"scene: found {len(scene)} values, expected (vertices, faces)")
        return (*_convert.mesh(*scene), None)
    vertices, faces = _convert.mesh(*_arrays(scene))
    return vertices, faces, _convert.colors(scene, len(vertices))


def _arrays(scene):
    """Return the vertices and faces of a RayScene, or of a mesh of trimesh or Open3D."""
    if hasattr(scene, "meshes"):  # a RayScene, whose module imports this one
        vertices, faces, first = [], [], 0
        for mesh_vertices, mesh_faces in scene.meshes:
            vertices.append(mesh_vertices)
            faces.append(mesh_faces.astype(np.int64) + first)
            first += len(mesh_vertices)
        return np.concatenate(vertices), np.concatenate(faces)
    if hasattr(scene, "vertices") and hasattr(scene, "faces"):
        return _convert.trimesh_arrays(scene)
    if hasattr(scene, "vertex") or (hasattr(scene, "vertices") and hasattr(scene, "triangles")):
        return _convert.open3d_arrays(scene)
    raise _convert.wrong_type("scene", scene, "a file, dict or mesh")


def _plain(value):
    """Return a value with numpy values and paths replaced by values that JSON can hold."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return os.fspath(value) if isinstance(value, os.PathLike) else value
