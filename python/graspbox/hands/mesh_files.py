"""The mesh files of robot descriptions: those that the core reads, and COLLADA (``.dae``; extra ``urdf``)."""

import warnings
from io import BytesIO
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import config_dict
from graspbox._common.imports import imported
from graspbox._core import Mesh
from graspbox.configs import CleanConfig, LoadConfig
from graspbox.errors import MeshError

__all__ = ["LARGEST_MESH", "check_reader", "read_mesh"]

Array = NDArray[np.float64]

#: Largest mesh file, bytes.
LARGEST_MESH = 32 << 20
#: Held while the filters of warnings are changed.
_FILTERS = Lock()


def check_reader(file: Path, place: str) -> None:
    """Raise a MissingExtraError for a file whose package is missing; `place` names it."""
    if file.suffix.lower() == ".dae":
        imported("collada", f"{place}: reading COLLADA needs the package pycollada", "urdf")


def read_mesh(file: Path, content: bytes, scale: tuple[float, float, float]) -> Mesh:
    """Read a mesh, in metres after its scale along each axis; `content` is that of the file. Its mass means nothing.

    Raises
    ------
    MeshError
        If the file is none, or has no triangles.
    MissingExtraError
        If it is a COLLADA file, without pycollada.
    """
    cleaning = config_dict(CleanConfig())
    if file.suffix.lower() == ".dae":
        vertices, faces = _collada(content)
    else:
        mesh = Mesh.load(file, file.stem, None, config_dict(LoadConfig(max_bytes=LARGEST_MESH)), cleaning, solid=False)
        if scale == (1.0, 1.0, 1.0):
            return mesh
        vertices, faces = mesh.vertices, mesh.faces
    return Mesh(vertices * np.array(scale), faces, file.stem, None, cleaning, None, solid=False)


def _collada(content: bytes) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices (n, 3), metres, and triangles (m, 3) of a COLLADA file, placed by its nodes.

    Its unit counts, its up axis does not, as in ROS: programs that write robot meshes set it without turning them.
    """
    collada: Any = imported("collada", "reading COLLADA needs the package pycollada", "urdf")
    try:
        # pycollada uses parts of numpy that are old; the filters of warnings are those of all threads.
        with _FILTERS, warnings.catch_warnings(action="ignore"):
            document = collada.Collada(BytesIO(content), ignore=[collada.common.DaeError])
            parts = [] if document.scene is None else list(document.scene.objects("geometry"))
            sets = [_triangles(primitive) for part in parts for primitive in part.primitives()]
            unit = float(document.assetInfo.unitmeter or 1.0)
    except Exception as error:  # pycollada raises whatever a damaged file leads to
        raise MeshError(f"is no COLLADA file that pycollada reads: {error}") from None
    found = [one for one in sets if one is not None and len(one[1])]
    if not found:
        raise MeshError("has no triangles in its scene")
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in found)])
    vertices = np.concatenate([vertices for vertices, _ in found])
    faces = np.concatenate([faces + start for (_, faces), start in zip(found, starts, strict=False)]).astype(np.uint32)
    return unit * vertices, faces


def _triangles(primitive: Any) -> tuple[Array, NDArray[np.uint32]] | None:
    """Return vertices and triangles of a part; None for lines."""
    if hasattr(primitive, "triangleset"):
        primitive = primitive.triangleset()
    indices = getattr(primitive, "vertex_index", None)
    if indices is None or np.ndim(indices) != 2 or np.shape(indices)[1] != 3:
        return None
    return np.asarray(primitive.vertex, dtype=np.float64), np.asarray(indices, dtype=np.uint32)
