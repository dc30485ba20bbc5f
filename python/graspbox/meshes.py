"""Meshes: read a file, or take arrays.

A `Mesh` is held in Rust; its arrays are fresh copies. Units are metres and kilograms, in the frame of the file.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from graspbox._core import Mesh
from graspbox.arguments import floats, to_json
from graspbox.configs import CleanConfig, LoadConfig
from graspbox.errors import ConfigError

__all__ = ["Mesh", "floats", "load_mesh", "mesh_from_arrays", "to_json"]


def load_mesh(
    path: str | os.PathLike[str],
    *,
    scale: float = 1.0,
    mass: float | None = None,
    name: str | None = None,
    clean: CleanConfig | None = CleanConfig(),  # noqa: B008 (frozen)
    limits: LoadConfig = LoadConfig(),  # noqa: B008 (frozen)
) -> Mesh:
    """Read a mesh file (.stl, .ply, .obj, .off).

    Parameters
    ----------
    path : str or PathLike
        The file.
    scale : float
        Metres in one unit of the file: 0.001 for millimetres.
    mass : float, optional
        Kilograms. Without it the mass is the volume times 400 kg/m3: household objects are hollow, or filled loosely.
    name : str, optional
        Name of the object; the file's by default.
    clean : CleanConfig, optional
        How to weld and orient the surface; None leaves it as it is.
    limits : LoadConfig
        How large a file may be.

    Returns
    -------
    Mesh
        In metres, in the frame of the file.

    Raises
    ------
    FileError
        If the file cannot be read (also an OSError).
    MeshError
        If it is empty, truncated, not made of polygons, or absurdly large or small (also a ValueError).
    """
    path = Path(path)
    options = to_json(replace(limits, scale=limits.scale * scale))
    return Mesh.load(path, name or path.stem, mass, options, None if clean is None else to_json(clean))


def mesh_from_arrays(vertices: ArrayLike, faces: ArrayLike, *, name: str = "mesh", mass: float | None = None) -> Mesh:
    """Make a mesh from arrays.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Metres.
    faces : (m, 3) array_like of int
        Vertex indices, counter-clockwise seen from outside.
    name : str
        Name of the object.
    mass : float, optional
        Kilograms; as in `load_mesh`.

    Raises
    ------
    MeshError
        If an index does not exist, or a coordinate is not finite.
    ConfigError
        If an array has the wrong shape.
    """
    indices = np.asarray(faces)
    if indices.ndim != 2 or indices.shape[1] != 3 or not np.issubdtype(indices.dtype, np.integer):
        raise ConfigError(f"faces has shape {indices.shape} and type {indices.dtype}; give (m, 3) integers")
    if indices.size and (indices.min() < 0 or indices.max() >= 2**32):
        raise ConfigError(f"faces holds {indices.min()} to {indices.max()}; vertex indices start at 0")
    return Mesh.from_arrays(floats(vertices), np.ascontiguousarray(indices, dtype=np.uint32), name, mass)
