"""Voxels: of a mesh, with the meaning of binvox's options, and from and to ``.binvox`` files.

| binvox    | here |
|---|---|
| ``-d N``  | ``resolution=N``: N voxels along the longest side of the bounds, whose least corner is the grid's |
| (default) | ``mode="solid"`` |
| ``-e``    | ``mode="surface"``; ``exact=True`` adds the touched voxels to a solid instead |
| ``-down`` | ``down``: each time a voxel is set where at least 4 of its 8 parts were |
| ``-ri``   | ``remove_internal=True``, last of all: voxels whose six neighbours are set are cleared |
"""

import os
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox.arguments import natural
from graspbox.by_value import ByValue
from graspbox.errors import ConfigError
from graspbox.meshes import MeshLike, as_mesh, floats

__all__ = ["Fill", "Mode", "Voxels", "load_binvox", "save_binvox", "voxelize"]

Mode = Literal["solid", "surface"]
Fill = Literal["winding", "parity", "vote"]


@dataclass(frozen=True, eq=False)
class Voxels(ByValue):
    """A cube of voxels, aligned with the axes of its frame: for a mesh, the object's.

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
        How inside was decided. ``winding``: the mesh is closed and oriented; inside is what it winds around.
        ``parity``: it is closed, but its faces disagree about a side; inside is where an odd number of crossings leads.
        ``vote``: it has holes; inside is what at least four of the six rays along the axes find it winding around.
        None for anything but a solid made here.
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
        """Volume of the voxels that are set, m3."""
        return int(self.occupancy.sum()) * self.voxel_size**3

    def centers(self) -> NDArray[np.float64]:
        """Give the centres of the voxels that are set: (m, 3), metres, in the order of their indices."""
        return self.origin + (np.argwhere(self.occupancy) + 0.5) * self.voxel_size

    def indices(self, points: ArrayLike) -> NDArray[np.int64]:
        """Give the index (m, 3) of the voxel around each point (m, 3); beyond the cube it is below 0 or n and above."""
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

    The grid is the cube whose least corner is that of the mesh's bounds and whose side is their longest side. A centre
    on the surface is taken a billionth of a voxel towards (+x, +y, +z); a voxel is touched by what comes within a
    billionth of its size.

    Parameters
    ----------
    mesh : Mesh, or an object with vertices and faces
        The object; see `graspbox.meshes.as_mesh`.
    resolution : int
        Voxels along each side before the grid is halved, 1 to 1024 (binvox's own limit). A grid takes 1 byte per voxel,
        and up to 3 while it is made.
    mode : str
        ``solid``: voxels whose centre lies inside. ``surface``: voxels that a triangle touches.
    down : int
        How often the resolution is halved; it must stay whole.
    remove_internal : bool
        Clear the voxels whose six neighbours are set, last of all. What lies beyond the grid counts as empty.
    exact : bool
        Set every voxel that a triangle touches as well; in mode ``surface`` they are all there is.

    Returns
    -------
    Voxels
        In the frame of the mesh, metres; ``fill`` tells how inside was decided.

    Raises
    ------
    ConfigError
        For an unknown mode, a resolution that is out of range or cannot be halved so often, or a grid that does not
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
        If it is truncated, its grid is no cube or its header does not tell the truth (also a ValueError).
    """
    return Voxels(*_core.load_binvox(path))


def save_binvox(path: str | os.PathLike[str], voxels: Voxels) -> None:
    """Write a ``.binvox`` file (version 1); its ``translate`` is the origin, its ``scale`` the side of the cube.

    Raises
    ------
    FileError
        If the folder is missing, full or read-only, or the path names a device or a pipe (also an OSError); an older
        file is then left as it was. A link stays, and the file that it names is written; a new file gets the mode that
        the umask leaves.
    """
    _core.save_binvox(path, voxels.occupancy, voxels.origin, voxels.voxel_size)
