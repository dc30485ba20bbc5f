"""Folders of meshes: which files there are objects, and what they are called."""

import os
from collections.abc import Iterator
from pathlib import Path

from graspbox.errors import ObjectSetError

__all__ = ["MESH_SUFFIXES", "meshes_in"]

#: Suffixes of mesh files that are read.
MESH_SUFFIXES = frozenset({".stl", ".ply", ".obj", ".off"})
#: Files that represent their folder, best first: YCB (two reconstructions, and the scanner's), APC 2015.
_LAYOUTS = (
    "meshes/tsdf_mesh.stl",
    "meshes/poisson_mesh.stl",
    "google_16k/nontextured.stl",
    "textured_meshes/optimized_tsdf_textured_mesh.ply",
)
#: Larger folders are refused: they are a mistake, such as ``dir:/``.
_MAX_FILES = 1_000_000


def meshes_in(folder: Path) -> list[tuple[str, Path]]:
    """Find the meshes of a folder with their names; a subfolder in a known layout is one object, called as it is."""
    found: list[tuple[str, Path]] = []
    for entry in sorted(folder.iterdir()):
        if entry.is_file() and entry.suffix.lower() in MESH_SUFFIXES:
            found.append((entry.stem, entry))
        elif entry.is_dir():
            layout = next((entry / file for file in _LAYOUTS if (entry / file).is_file()), None)
            found += [(entry.name, layout)] if layout else _below(folder, entry)
    return found


def _below(root: Path, folder: Path) -> Iterator[tuple[str, Path]]:
    """Find the meshes in a folder and the folders below it, named by their path from `root`; links are not followed."""

    def fail(error: OSError) -> None:
        raise error

    paths: list[Path] = []
    seen = 0
    for parent, _, names in os.walk(folder, onerror=fail):
        seen += len(names)
        if seen > _MAX_FILES:
            raise ObjectSetError(f"there are more than {_MAX_FILES} files in {str(folder)!r}; name a smaller folder")
        paths += [Path(parent, name) for name in names if Path(name).suffix.lower() in MESH_SUFFIXES]
    for path in sorted(paths):
        if path.is_file():
            yield path.relative_to(root).with_suffix("").as_posix(), path
