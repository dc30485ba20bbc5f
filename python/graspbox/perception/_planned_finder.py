"""Grasps of the planner, on the surface that a camera sees or that a completion makes of it."""

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Hand, Mesh
from graspbox.errors import ConfigError, MeshError, PlanError
from graspbox.meshes import mesh_from_arrays
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import OCCUPIED, Crops
from graspbox.perception.finder import Clock, Complete, Finder, Ranked, observed_only, volume_of

__all__ = ["PlannedFinder", "surface_mesh"]

#: Mass of the mesh, kilograms; no plan depends on it.
_MASS = 0.1
#: Corners of a cell, and the pairs of them that its edges join.
_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
_EDGES = [(a, b) for a in range(8) for b in range(a) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]


class PlannedFinder(Finder):
    """Finds grasps in depth images as the planner does in meshes, ranked by geometry alone.

    The grasps that it finds are the planner's feasible ones, best first, with the planner's scores; their
    `FoundGrasp.seconds` are those of ``crop``, ``complete`` and ``propose``.

    Parameters
    ----------
    hand : Hand
        The hand.
    complete : callable
        Predicts the occupancy of crops; `observed_only` plans on the visible surface.
    crop : CropConfig
        The crop.

    Raises
    ------
    PlanError
        If the planner does not support the hand.
    """

    def __init__(
        self,
        hand: Hand,
        complete: Complete = observed_only,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__(crop)
        self._hand, self._complete = hand, complete
        n = crop.resolution
        block = np.zeros((n, n, n), dtype=np.uint8)
        block[n // 2 - 4 : n // 2 + 4, n // 2 - 4 : n // 2 + 4, 3:11] = 255
        mesh = surface_mesh(block, crop)
        assert mesh is not None
        # Fails here for a hand that the planner does not support, instead of at the first image.
        planning.plan(mesh, hand=hand, world_from_object=np.eye(4))

    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked | None:
        """Score grasps: see `Finder.rank`. None where the visible surface is too small or too flat to plan for."""
        volume = volume_of(crops, self._complete)
        clock.lap("complete")
        mesh = surface_mesh(volume[0], self.crop)
        if mesh is None:
            return None
        try:
            plan = planning.plan(mesh, hand=self._hand, seed=seed % 2**32, world_from_object=np.eye(4)).best()
        except (MeshError, PlanError):
            return None
        clock.lap("propose")
        return Ranked(volume, plan.poses, plan.preshape, plan.score)


def surface_mesh(occupancy: NDArray[np.uint8], crop: CropConfig = CropConfig()) -> Mesh | None:  # noqa: B008 (frozen)
    """Give the surface of a volume in the crop frame, closed; None where nothing is occupied.

    Parameters
    ----------
    occupancy : (N, N, N) uint8
        Voxels of a crop, 0 to 255 for 0 to 1; occupied from a quarter on.
    crop : CropConfig
        The crop.

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
        raise ConfigError(f"occupancy is {occupancy.shape} {occupancy.dtype}; give {(n, n, n)} uint8")
    # A margin of free voxels closes the surface at the sides of the crop.
    values = np.pad(occupancy.astype(np.float64), 1) - (OCCUPIED - 0.5)
    inside = values > 0
    if not inside.any():
        return None
    vertices, index = _vertices(values)
    squares = [_squares(inside, index, axis) for axis in range(3)]
    quads = np.concatenate(squares)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    # Voxel (0, 0, 0) of the padded array has its centre half a voxel outside of the crop.
    origin = np.asarray(crop.origin) - 0.5 * crop.voxel_size
    return mesh_from_arrays(origin + vertices * crop.voxel_size, faces, mass=_MASS, name="seen", clean=None)


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
