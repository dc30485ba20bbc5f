"""Voxelization of meshes with the options of binvox, and ``.binvox`` files.

| binvox    | here |
|---|---|
| ``-d N``  | ``resolution=N``: N voxels along the longest side of the bounds; the grid starts at their least corner |
| (default) | ``mode="solid"`` |
| ``-e``    | ``mode="surface"``; with ``exact=True``, a solid also contains all touched voxels |
| ``-down`` | ``down``: halves the resolution; a voxel is set if at least 4 of its 8 parts were |
| ``-ri``   | ``remove_internal=True``: finally clears voxels whose six neighbours are set |
"""

import os
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import natural
from graspbox._common.by_value import ByValue
from graspbox.errors import ConfigError
from graspbox.meshes import MeshLike, as_mesh, floats

__all__ = ["Fill", "Mode", "Voxels", "load_binvox", "save_binvox", "voxelize"]

Mode = Literal["solid", "surface"]
Fill = Literal["winding", "parity", "vote"]


@dataclass(frozen=True, eq=False)
class Voxels(ByValue):
    """A cube of voxels aligned with the axes of its frame; for a mesh, the object's frame.

    The centre of voxel (i, j, k) is ``origin + (np.array([i, j, k]) + 0.5) * voxel_size``.

    Attributes
    ----------
    occupancy : (n, n, n) bool
        Whether each voxel is set, by its index along x, y and z.
    origin : (3,) float64
        Least corner of the cube, metres.
    voxel_size : float
        Side of a voxel, metres.
    fill : str or None
        Rule for the inside. ``winding``: the mesh is closed and oriented; the winding number decides. ``parity``: it is
        closed, but its faces are oriented inconsistently; inside is where rays cross it an odd number of times.
        ``vote``: it has holes; inside is where it winds around the point by at least four of the six rays along the
        axes. None for all voxels but solids made by `voxelize`.
    """

    occupancy: NDArray[np.bool_]
    origin: NDArray[np.float64]
    voxel_size: float
    fill: Fill | None = None

    def __post_init__(self) -> None:
        occupancy = np.ascontiguousarray(self.occupancy)
        if occupancy.ndim != 3 or len(set(occupancy.shape)) != 1 or occupancy.dtype != np.bool_:
            raise ConfigError(f"occupancy has shape {occupancy.shape} and type {occupancy.dtype}; give (n, n, n) bool")
        origin = floats(self.origin)
        if origin.shape != (3,):
            raise ConfigError(f"origin has shape {origin.shape}; give (3,)")
        if not 0.0 < self.voxel_size < np.inf:
            raise ConfigError(f"voxel_size is {self.voxel_size}; give a positive number of metres")
        object.__setattr__(self, "occupancy", occupancy)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "voxel_size", float(self.voxel_size))

    def __repr__(self) -> str:
        n = self.resolution
        return f"Voxels({n} x {n} x {n}, {self.occupancy.sum()} set, voxel_size={self.voxel_size:.6g})"

    @property
    def resolution(self) -> int:
        """Voxels along each side."""
        return len(self.occupancy)

    @property
    def volume(self) -> float:
        """Volume of the set voxels, m3."""
        return int(self.occupancy.sum()) * self.voxel_size**3

    def centers(self) -> NDArray[np.float64]:
        """Return the centres of the set voxels, (m, 3), metres, in the order of their indices."""
        return self.origin + (np.argwhere(self.occupancy) + 0.5) * self.voxel_size

    def indices(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the index (m, 3) of the voxel around each point (m, 3); outside the cube it is < 0 or >= n."""
        return np.floor((floats(points) - self.origin) / self.voxel_size).astype(np.int64)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a ``.binvox`` file; see `save_binvox`."""
        save_binvox(path, self)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> "Voxels":
        """Read a ``.binvox`` file; see `load_binvox`."""
        return load_binvox(path)


def voxelize(
    mesh: MeshLike,
    resolution: int = 32,
    mode: Mode = "solid",
    *,
    down: int = 0,
    remove_internal: bool = False,
    exact: bool = False,
) -> Voxels:
    """Voxelize a mesh.

    The grid is a cube with the least corner of the mesh's bounds and the length of their longest side. A centre on the
    surface is moved by a billionth of a voxel towards (+x, +y, +z); a triangle within a billionth of a voxel's size
    touches it.

    Parameters
    ----------
    mesh : Mesh, or an object with vertices and faces
        The object; see `graspbox.meshes.as_mesh`.
    resolution : int
        Voxels along each side before halving, 1 to 1024 (binvox's limit). A grid takes 1 byte per voxel, and up to 3
        bytes during construction.
    mode : str
        ``solid``: voxels whose centre lies inside. ``surface``: voxels that a triangle touches.
    down : int
        How many times to halve the resolution, which must stay an integer.
    remove_internal : bool
        Finally clear the voxels whose six neighbours are set. Voxels outside the grid count as empty.
    exact : bool
        Also set every voxel that a triangle touches; mode ``surface`` sets these in any case.

    Returns
    -------
    Voxels
        In the frame of the mesh, metres; ``fill`` is the rule for the inside.

    Raises
    ------
    ConfigError
        For an unknown mode, a resolution that is out of range or cannot be halved `down` times, or a grid that does not
        fit into memory.
    """
    if mode not in get_args(Mode):
        raise ConfigError(f"mode is {mode!r}; choose solid or surface")
    sides, halvings = natural(resolution, "resolution"), natural(down, "down")
    grid, fill = _core.voxelize(as_mesh(mesh), sides, mode, halvings, remove_internal, exact)
    return Voxels(*grid, fill=cast(Fill | None, fill))


def load_binvox(path: str | os.PathLike[str]) -> Voxels:
    """Read a ``.binvox`` file.

    Raises
    ------
    FileError
        If the file cannot be read (also an OSError).
    MeshError
        If it is truncated, its grid is not a cube, or its header contradicts its contents (also a ValueError).
    """
    return Voxels(*_core.load_binvox(path))


def save_binvox(path: str | os.PathLike[str], voxels: Voxels) -> None:
    """Write a ``.binvox`` file (version 1); ``translate`` is the origin, ``scale`` the side of the cube.

    Links are followed. A new file gets the permissions of the umask.

    Raises
    ------
    FileError
        If the folder is missing, full or read-only, or the path is a device or a pipe (also an OSError); an existing
        file is not changed.
    """
    _core.save_binvox(path, voxels.occupancy, voxels.origin, voxels.voxel_size)
