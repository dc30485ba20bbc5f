"""The surface of a volume: vertices and faces, or a mesh."""

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Mesh
from graspbox.errors import ConfigError
from graspbox.meshes import mesh_from_arrays
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import OCCUPIED

__all__ = ["surface_mesh", "surface_of"]

#: Corners of a cell, and the pairs of them that its edges join.
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_EDGES = [(a, b) for a in range(8) for b in range(a) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


def surface_mesh(
    occupancy: NDArray[np.uint8],
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    *,
    mass: float = 0.1,
) -> Mesh | None:
    """Return the closed surface of a volume in the crop frame as a mesh of `mass` kg; None if nothing is occupied.

    Other arguments and errors as `surface_of`.
    """
    surface = surface_of(occupancy, crop)
    return None if surface is None else mesh_from_arrays(*surface, mass=mass, name="seen", clean=None)


def surface_of(
    occupancy: NDArray[np.uint8],
    crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    *,
    threshold: int = OCCUPIED,
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Return the closed surface of a volume in the crop frame: vertices (v, 3), metres, and triangles (f, 3).

    None if no voxel of the (N, N, N) uint8 `occupancy` of a crop has the least value of an occupied one, `threshold`.

    Raises
    ------
    ConfigError
        For an array of another shape or type.

    Notes
    -----
    Surface nets (Gibson, "Constrained elastic surface nets", MICCAI 1998), without the relaxation: one vertex in each
    cell between voxel centres that the surface crosses, at the mean of the crossings of its edges, and one square for
    each pair of neighbouring voxels, one occupied and one free.
    """
    n = crop.resolution
    if occupancy.shape != (n, n, n) or occupancy.dtype != np.uint8:
        raise ConfigError(f"occupancy is {occupancy.shape} {occupancy.dtype}; pass {(n, n, n)} uint8")
    # A margin of free voxels closes the surface at the sides of the crop.
    values = np.pad(occupancy.astype(np.float64), 1) - (threshold - 0.5)
    inside = values > 0
    if not inside.any():
        return None
    vertices, index = _vertices(values)
    squares = [_squares(inside, index, axis) for axis in range(3)]
    quads = np.concatenate(squares)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    # Voxel (0, 0, 0) of the padded array has its centre half a voxel outside of the crop.
    origin = np.asarray(crop.origin) - 0.5 * crop.voxel_size
    return origin + vertices * crop.voxel_size, faces


def _vertices(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Place the vertices (v, 3), in voxels, and number the cells that have one (-1: none)."""
    cells = np.array(values.shape) - 1
    corner = [values[x : x + cells[0], y : y + cells[1], z : z + cells[2]] for x, y, z in _CORNERS]
    positive = np.sum([c > 0 for c in corner], axis=0)
    crossed = np.nonzero((positive > 0) & (positive < 8))
    at = np.stack([c[crossed] for c in corner], axis=1)
    total, count = np.zeros((len(at), 3)), np.zeros(len(at))
    for a, b in _EDGES:
        crosses = (at[:, a] > 0) != (at[:, b] > 0)
        share = np.where(crosses, at[:, a] / np.where(crosses, at[:, a] - at[:, b], 1.0), 0.0)
        total += crosses[:, None] * (_CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a]))
        count += crosses
    index = np.full(cells, -1, dtype=np.int64)
    index[crossed] = np.arange(len(at))
    return np.stack(crossed, axis=1) + total / count[:, None], index


def _squares(inside: NDArray[np.bool_], index: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Join the four cells around each pair of an occupied and a free voxel along an axis, (q, 4)."""
    before, after = np.moveaxis(inside, axis, 0)[:-1], np.moveaxis(inside, axis, 0)[1:]
    layer, v, w = np.nonzero(before != after)
    turned = np.moveaxis(index, axis, 0)
    around = np.stack([turned[layer, v - dv, w - dw] for dv, dw in ((1, 1), (0, 1), (0, 0), (1, 0))], axis=1)
    # Seen from the free voxel the square runs counter-clockwise; the middle axis mirrors the order of the other two.
    flipped = before[layer, v, w] == (axis == 1)
    return np.where(flipped[:, None], around[:, ::-1], around)
