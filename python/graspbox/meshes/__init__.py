"""Meshes: read a file, convert arrays, or convert another library's mesh.

A `Mesh` is stored in Rust; its arrays are fresh copies. Units are metres and kilograms, in the frame of the file.
"""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import config_dict, floats
from graspbox._core import Mesh
from graspbox.configs import CleanConfig, LoadConfig
from graspbox.errors import ConfigError

__all__ = [
    "Mesh",
    "MeshLike",
    "Surroundings",
    "as_mesh",
    "floats",
    "load_mesh",
    "mesh_from_arrays",
    "placed",
]

#: Objects with their poses, and boxes with their poses and half extents, as the core takes them.
Placed = tuple[list[tuple[Mesh, NDArray[np.float64]]], list[tuple[NDArray[np.float64], list[float]]]]


class Triangles(Protocol):
    """A mesh of another library, such as a ``trimesh.Trimesh``."""

    @property
    def vertices(self) -> ArrayLike:
        """Positions (n, 3), metres."""

    @property
    def faces(self) -> ArrayLike:
        """Vertex indices (m, 3)."""


class Surroundings(Protocol):
    """What is around an object: `graspbox.Arrangement` is one."""

    @property
    def meshes(self) -> Sequence[Mesh]:
        """The k objects."""

    @property
    def world_from_objects(self) -> NDArray[np.float64]:
        """Poses of the objects, (k, 4, 4)."""

    @property
    def world_from_walls(self) -> NDArray[np.float64]:
        """Poses of w boxes, (w, 4, 4)."""

    @property
    def wall_half_extents(self) -> NDArray[np.float64]:
        """Half extents of the boxes, (w, 3), metres."""


#: Sources that `as_mesh` accepts.
MeshLike = Mesh | Triangles


def load_mesh(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    mass: float | None = None,
    name: str | None = None,
    clean: CleanConfig | None = CleanConfig(),  # noqa: B008 (frozen)
    limits: LoadConfig = LoadConfig(),  # noqa: B008 (frozen)
) -> Mesh:
    """Read a mesh file (.stl, .ply, .obj, .off, .glb, .gltf); all objects in it become one mesh.

    Coordinates stay those of the file, as in trimesh: in glTF the y axis is vertical, and is not turned to z.

    Parameters
    ----------
    path : str or PathLike
        A regular file; devices and pipes are refused.
    scale : float
        Metres per unit of the file: 0.001 for millimetres.
    mass : float, optional
        Kilograms. By default the volume times 400 kg/m3, because household objects are hollow or loosely filled.
    name : str, optional
        Name of the object; the file's by default.
    clean : CleanConfig, optional
        How to weld and orient the surface; None leaves it unchanged.
    limits : LoadConfig
        Limits on the size of a file.

    Returns
    -------
    Mesh
        In metres, in the frame of the file.

    Raises
    ------
    FileError
        If the file cannot be read (also an OSError).
    MeshError
        If it is empty, truncated, of another format than its suffix indicates, not made of polygons, or absurdly large
        or small (also a ValueError).

    Warns
    -----
    UserWarning
        Before a mesh of more than 300,000 faces is cleaned, which takes long.
    """
    path = Path(path)
    options = config_dict(replace(limits, scale=limits.scale * scale))
    return Mesh.load(path, name or path.stem, mass, options, None if clean is None else config_dict(clean))


def mesh_from_arrays(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    scale: float = 1.0,
    mass: float | None = None,
    name: str = "mesh",
    clean: CleanConfig | None = CleanConfig(),  # noqa: B008 (frozen)
) -> Mesh:
    """Make a mesh from arrays, cleaned as by `load_mesh`.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Positions, in units of `scale` metres. Vertices that no face uses are dropped.
    faces : (m, 3) array_like of int
        Vertex indices, counter-clockwise viewed from outside.
    scale : float
        Metres per unit of `vertices`: 0.001 for millimetres.
    mass : float, optional
        Kilograms; as in `load_mesh`.
    name : str
        Name of the object.
    clean : CleanConfig, optional
        How to weld and orient the surface; None leaves it unchanged.

    Raises
    ------
    MeshError
        If an index does not exist, or the mesh is empty, absurdly large or small (also a ValueError).
    ConfigError
        If an array has the wrong shape, or holds numbers that are not finite (also a ValueError).
    """
    indices = np.asarray(faces)
    if indices.ndim != 2 or indices.shape[1] != 3 or not np.issubdtype(indices.dtype, np.integer):
        raise ConfigError(f"faces has shape {indices.shape} and type {indices.dtype}; give (m, 3) integers")
    if indices.size and (indices.min() < 0 or indices.max() >= 2**32):
        raise ConfigError(f"faces holds {indices.min()} to {indices.max()}; vertex indices start at 0")
    if not 0.0 < scale < np.inf:
        raise ConfigError(f"scale is {scale}; give the positive number of metres in one unit of the vertices")
    points = floats(vertices)
    if scale != 1.0:
        points = points * float(scale)
    corners = np.ascontiguousarray(indices, dtype=np.uint32)
    return Mesh(points, corners, name, mass, None if clean is None else config_dict(clean), None)


def as_mesh(source: MeshLike, name: str = "mesh") -> Mesh:
    """Return a `Mesh` unchanged, or convert another library's.

    Parameters
    ----------
    source : Mesh or object
        A `Mesh`, or an object with ``vertices`` (n, 3) in metres and ``faces`` (m, 3), such as a ``trimesh.Trimesh``;
        it is converted by `mesh_from_arrays` at every call.
    name : str
        Name of the argument, for errors.

    Raises
    ------
    ConfigError
        If it is neither (also a ValueError).
    MeshError
        As `mesh_from_arrays`.
    """
    if isinstance(source, Mesh):
        return source
    vertices, faces = getattr(source, "vertices", None), getattr(source, "faces", None)
    if vertices is None or faces is None:
        if isinstance(source, str | os.PathLike):
            raise ConfigError(f"{name} is the path {os.fspath(source)!r}; read it with graspbox.load_mesh")
        raise ConfigError(
            f"{name} is a {type(source).__name__}; give a graspbox.Mesh (made by load_mesh or mesh_from_arrays), "
            "or an object with vertices and faces, such as a trimesh.Trimesh"
        )
    return mesh_from_arrays(vertices, faces)


def placed(around: Surroundings | None) -> Placed:
    """Pair objects and walls with their poses; there are none without surroundings."""
    if around is None:
        return [], []
    objects = list(zip(around.meshes, around.world_from_objects, strict=True))
    return objects, list(zip(around.world_from_walls, around.wall_half_extents.tolist(), strict=True))
