from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike, NDArray

class Picture(dict[str, NDArray[Any]]):
    warnings: list[str]
    def write(self, prefix: str | PathLike[str], *, float: bool = False) -> list[Path]: ...
    def write_exr(self, path: str | PathLike[str], *, float: bool = False) -> None: ...
    def write_png(self, path: str | PathLike[str]) -> None: ...

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
) -> Picture: ...
def render_views(scene: Any, cameras: Iterable[Mapping[str, Any]], **options: Any) -> Iterator[Picture]: ...
def thumbnail(scene: Any) -> bytes: ...
