"""The truth in place of a part of `DepthGrasp`, to measure what that part loses; privileged."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Mesh
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.perturbations import perturbed
from graspbox.simulation import Scene

__all__ = ["Truth"]

#: The oracle of the scorer simulates every proposal once, and then this many successes with a wrong hand this often.
_ORACLE_FINALISTS, _ORACLE_REPLAYS = 12, 8
#: Standard deviation of the hand's error in these replays, metres and radians.
_ORACLE_ERROR = 0.003, 0.05


class Truth:
    """What the simulation knows of one episode, for the oracles."""

    def __init__(
        self, mesh: Mesh, world_from_object: NDArray[np.float64], crop: CropConfig, hand: Any, seed: int
    ) -> None:
        self._mesh, self._pose, self._crop, self._hand = mesh, world_from_object, crop, hand
        self._rng = np.random.default_rng([seed, 1])
        self._world_from_crop = np.eye(4)
        self._simulated = False

    def place(self, world_from_crop: NDArray[np.float64]) -> None:
        """Learn where the crop is."""
        self._world_from_crop = world_from_crop

    def complete(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Give the object's own occupancy."""
        inside = np.linalg.inv(self._world_from_crop) @ self._pose
        return solid_occupancy([self._mesh], [0], inside[None], config=self._crop)

    def score(
        self, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Simulate: all grasps once, then the first successes again with errors of the hand.

        The score is the share of successes, plus a hundredth of the share of secure ones. Grasps of a refinement score
        0.
        """
        if self._simulated:
            return np.zeros(len(preshapes))
        self._simulated = True
        scene = Scene(self._mesh, hand=self._hand, world_from_object=self._pose)
        object_from_hand = np.linalg.inv(scene.world_from_object) @ self._world_from_crop @ poses
        outcomes = scene.simulate(object_from_hand, preshapes)
        scores = 0.1 * (outcomes.success + 0.01 * outcomes.secure)
        finalists = np.argsort(-scores, kind="stable")[:_ORACLE_FINALISTS]
        finalists = finalists[outcomes.success[finalists]]
        if len(finalists):
            rows = np.repeat(finalists, _ORACLE_REPLAYS)
            again = scene.simulate(perturbed(object_from_hand[rows], self._rng, *_ORACLE_ERROR), preshapes[rows])
            shares = again.success.reshape(-1, _ORACLE_REPLAYS).mean(axis=1)
            secure = again.secure.reshape(-1, _ORACLE_REPLAYS).mean(axis=1)
            scores[finalists] = 0.2 + shares + 0.01 * secure
        return np.asarray(scores, dtype=np.float64)
