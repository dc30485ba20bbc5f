"""The truth in place of a part of `DepthGrasp`, or of all of a policy, to measure what is lost; privileged."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Mesh
from graspbox.envs.coding import encode_action, object_pose
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.perturbations import perturbed
from graspbox.policies.base import Actions, Task
from graspbox.policies.planner import Planner
from graspbox.simulation import Scene

__all__ = ["Replays", "RobustOracle", "Truth", "robust_scores"]

#: Among how many of the planner's best poses `RobustOracle` chooses.
_SIMULATED = 60


@dataclass(frozen=True)
class Replays:
    """How an oracle simulates grasps: each once, then some of the successes again with errors of the hand.

    Attributes
    ----------
    finalists : int
        How many successes are replayed.
    count : int
        Replays of each.
    position, rotation : float
        Standard deviation of the error along and about each axis of the hand, metres and radians.
    """

    finalists: int = 12
    count: int = 8
    position: float = 0.003
    rotation: float = 0.05


def robust_scores(
    scene: Scene,
    object_from_hand: NDArray[np.float64],
    preshapes: NDArray[np.float64],
    rng: np.random.Generator,
    replays: Replays = Replays(),
) -> NDArray[np.float64]:
    """Score grasps (m, 4, 4) by simulation.

    A finalist has 0.2 plus the share of its replays that succeed, plus a hundredth of the share of secure ones. Another
    success has about 0.1, a failure 0.
    """
    outcomes = scene.simulate(object_from_hand, preshapes)
    scores = 0.1 * (outcomes.success + 0.01 * outcomes.secure)
    finalists = np.argsort(-scores, kind="stable")[: replays.finalists]
    finalists = finalists[outcomes.success[finalists]]
    if len(finalists):
        rows = np.repeat(finalists, replays.count)
        moved = perturbed(object_from_hand[rows], rng, replays.position, replays.rotation)
        again = scene.simulate(moved, preshapes[rows])
        shares = again.success.reshape(-1, replays.count).mean(axis=1)
        secure = again.secure.reshape(-1, replays.count).mean(axis=1)
        scores[finalists] = 0.2 + shares + 0.01 * secure
    return np.asarray(scores, dtype=np.float64)


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
        """Simulate the grasps (`robust_scores`); those of a refinement score 0."""
        if self._simulated:
            return np.zeros(len(preshapes))
        self._simulated = True
        scene = Scene(self._mesh, hand=self._hand, world_from_object=self._pose)
        object_from_hand = np.linalg.inv(scene.world_from_object) @ self._world_from_crop @ poses
        return robust_scores(scene, object_from_hand, preshapes, self._rng)


class RobustOracle(Planner):
    """Grasps at that of the planner's poses which succeeds most often under errors of the hand; **privileged**.

    It simulates each of the 60 first-ranked poses once, and up to 12 successes 16 times with errors of 5 mm and 5
    degrees along and about each axis of the hand. It tells how much better than the planner's own order one can choose
    among its poses.
    """

    name = "robust_oracle"
    env_id = "graspbox/GraspPose-v0"
    _replays = Replays(finalists=12, count=16, position=0.005, rotation=float(np.radians(5.0)))

    def _bind(self, task: Task) -> None:
        if task.closed_loop:
            raise ConfigError(f"the policy {self.name!r} acts in graspbox/GraspPose-v0, not in {task.env_id!r}")
        super()._bind(task)

    def _decide(self, mesh: Mesh, state: NDArray[np.float32], nothing: Actions) -> Actions:
        """Choose among the feasible poses of the planner."""
        pose = object_pose(state, hand=self._hand)
        plan = planning.plan(mesh, hand=self._hand, world_from_object=pose).best(_SIMULATED)
        if not len(plan):
            return nothing
        scene = Scene(mesh, hand=self._hand, world_from_object=pose)
        object_from_hand = np.linalg.inv(scene.world_from_object) @ pose @ plan.poses
        # The same scene has the same replays, beside whatever other environments.
        rng = np.random.default_rng(np.frombuffer(state.tobytes(), dtype=np.uint32))
        scores = robust_scores(scene, object_from_hand, plan.preshape, rng, self._replays)
        best = int(np.argmax(scores))
        return encode_action(pose @ plan.poses[best], plan.preshape[best], hand=self._hand)
