"""Which grasps of an object in a crop the open hand can reach, and how far from its middle the hand is.

The object is all that is occupied, or the part of it that belongs to a target (`belonging`). The open hand avoids
everything that is occupied, the table, and known obstacles, such as the walls of a bin.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspbox.perception.configs import ProposalConfig
from graspbox.perception.crops import OCCUPIED
from graspbox.perception.hand_grids import HandGrid, Proposals

__all__ = ["Reachability", "belonging"]

#: Factor of the number of approached points among obstacles, and the most that `HandGrid.propose` takes.
_MORE, _MOST_SEEDS = 4, 1000


@dataclass(frozen=True, eq=False)
class Reachability:
    """The object to grasp in a crop, and what the open hand avoids.

    `occupancy` (N, N, N), 0 to 255 for 0 to 1, is all that is occupied, `target` the part of it to grasp, by default
    all;
    `obstacles` (k, 3) are other occupied points of the crop's frame, metres. `fingers` and `points` of `config` hold
    for
    all grasps, not only for proposals.
    """

    grid: HandGrid
    config: ProposalConfig
    occupancy: NDArray[np.uint8]
    target: NDArray[np.uint8] | None
    obstacles: NDArray[np.float64]

    def propose(self) -> Proposals:
        """Propose grasps: see `HandGrid.propose`. If obstacles leave few, more points of the object are approached."""
        found, config = self._proposed(self.config), self.config
        if len(self.obstacles) and len(found) < config.most:
            found = self._proposed(replace(config, seeds=min(_MORE * config.seeds, _MOST_SEEDS)))
        return found

    def _proposed(self, config: ProposalConfig) -> Proposals:
        if self.target is None:
            return self.grid.propose(self.occupancy, config, obstacles=self.obstacles)
        return self.grid.propose(self.target, config, whole=self.occupancy, obstacles=self.obstacles)

    def free(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where the open hand at ``crop_from_hand`` (m, 4, 4), with preshapes (m,), touches nothing, (m,)."""
        return self._meets(self.occupancy, poses, preshapes)[0]

    def feasible(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return where the open hand touches nothing and enough fingers meet the object as they close; as `free`."""
        free, fingers = self._meets(self.occupancy, poses, preshapes)
        if self.target is not None:
            _, fingers = self._meets(self.target, poses, preshapes)
        return free & (fingers >= min(self.config.fingers, 2))

    def levers(self, poses: NDArray[np.float64], preshapes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `HandGrid.levers` for the object, (m,), metres."""
        held = self.occupancy if self.target is None else self.target
        return self.grid.levers(held, poses, preshapes)

    def _meets(
        self, occupancy: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        return self.grid.meets(occupancy, poses, preshapes, points=self.config.points, obstacles=self.obstacles)


def belonging(occupancy: NDArray[np.uint8], others: NDArray[np.bool_], target: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Keep the occupied voxels (N, N, N) that are reached from the target's visible ones before those of others.

    From all visible voxels, ownership spreads through occupied ones, step by step to their neighbours.
    """
    occupied = np.pad((occupancy >= OCCUPIED) | target, 1)
    own = np.pad(target, 1)
    other = np.pad(others & ~target, 1) & occupied
    while True:
        free = occupied & ~own & ~other
        more = _spread(own) & free, _spread(other) & free
        if not (more[0].any() or more[1].any()):
            break
        own |= more[0]
        other |= more[1] & ~more[0]
    inside = own[1:-1, 1:-1, 1:-1]
    return np.ascontiguousarray(np.where(inside, occupancy, np.uint8(0)))


def _spread(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add the six neighbours of true voxels; those at the border are false, so that nothing spreads around it."""
    flat = cells.ravel()
    grown = flat.copy()
    for step in (1, cells.shape[2], cells.shape[1] * cells.shape[2]):
        grown[step:] |= flat[:-step]
        grown[:-step] |= flat[step:]
    return grown.reshape(cells.shape)
