"""Network inputs of candidate grasps: the voxels around the hand, its pose and its preshape."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.perception.hand_grids import HandGrid

__all__ = ["GraspInputs", "ScorerInputs"]


class GraspInputs(NamedTuple):
    """Inputs of m grasps: `HandGrid.crops`, ``crop_from_hand`` (m, 4, 4), metres, and preshapes by index."""

    cells: NDArray[np.uint8]
    poses: NDArray[np.float32]
    preshape: NDArray[np.int64]


class ScorerInputs:
    """Makes the scorer's inputs for one hand; `first` is its first preshape's index in a network of several hands."""

    def __init__(self, grid: HandGrid, first: int = 0) -> None:
        self.grid, self.first = grid, first

    def make(
        self,
        volumes: NDArray[np.uint8],
        crop_of: NDArray[np.int64],
        crop_from_hand: NDArray[np.float64],
        preshape: NDArray[np.float64],
    ) -> GraspInputs:
        """Make inputs of m grasps in s crops, whose volumes are those of `HandGrid.crops`."""
        cells = self.grid.crops(volumes, crop_of, crop_from_hand)
        return GraspInputs(cells, crop_from_hand.astype(np.float32), self.grid.nearest(preshape) + self.first)

    def reflected(self, inputs: GraspInputs, rng: np.random.Generator) -> GraspInputs:
        """Reflect each grasp and its scene by a random symmetry of the hand (`HandGrid.symmetries`), or not at all.

        Of a reflected pose only what a scorer reads is right: height, and direction of gravity in the hand frame.
        """
        if not self.grid.symmetries:
            return inputs
        choice = rng.integers(len(self.grid.symmetries) + 1, size=len(inputs.preshape))
        cells, poses = inputs.cells.copy(), inputs.poses.copy()
        for number, signs in enumerate(self.grid.symmetries, 1):
            rows = np.flatnonzero(choice == number)
            cells[rows] = np.flip(cells[rows], tuple(2 + axis for axis in range(3) if signs[axis] < 0.0))
            poses[rows, :3, :3] *= np.array(signs, dtype=np.float32)
        return inputs._replace(cells=cells, poses=poses)
