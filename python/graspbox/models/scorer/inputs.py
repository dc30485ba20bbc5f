"""Network inputs of candidate grasps: the voxels around the hand, its pose and its preshape; no torch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.perception.hand_grids import HandGrid

__all__ = ["GraspInputs", "ScorerInputs"]


class GraspInputs(NamedTuple):
    """Inputs of m grasps.

    Attributes
    ----------
    cells : (m, 4, X, Y, Z) uint8
        As `HandGrid.crops` returns them.
    poses : (m, 4, 4) float32
        ``crop_from_hand``, metres.
    preshape : (m,) int64
        Number of the hand's nearest preshape.
    """

    cells: NDArray[np.uint8]
    poses: NDArray[np.float32]
    preshape: NDArray[np.int64]


class ScorerInputs:
    """Makes the scorer's inputs for one hand.

    Parameters
    ----------
    grid : HandGrid
        Voxel grid of the hand.
    first : int
        Number of its first preshape, in a network of several hands.
    """

    def __init__(self, grid: HandGrid, first: int = 0) -> None:
        self.grid, self.first = grid, first

    def make(
        self,
        volumes: NDArray[np.uint8],
        crop_of: NDArray[np.int64],
        crop_from_hand: NDArray[np.float64],
        preshape: NDArray[np.float64],
    ) -> GraspInputs:
        """Make inputs of m grasps in s crops.

        Parameters
        ----------
        volumes : (s, 3, N, N, N) uint8
            As for `HandGrid.crops`: completed, surface, unseen.
        crop_of : (m,) int64
            The crop of each grasp.
        crop_from_hand : (m, 4, 4) float64
            Metres.
        preshape : (m,) float64
            The nearest of the hand's preshapes is used.
        """
        cells = self.grid.crops(volumes, crop_of, crop_from_hand)
        return GraspInputs(cells, crop_from_hand.astype(np.float32), self.grid.nearest(preshape) + self.first)

    def reflected(self, inputs: GraspInputs, rng: np.random.Generator) -> GraspInputs:
        """Reflect each grasp and its scene by a random symmetry of the hand (`HandGrid.symmetries`), or not at all.

        The cells are those of the reflected scene. Of a reflected pose only what a scorer reads is meant: height, and
        direction of gravity in the hand frame.
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
