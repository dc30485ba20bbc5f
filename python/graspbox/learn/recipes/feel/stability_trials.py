"""Training data of grasp stability: a policy's grasps, sensed while closing and always lifted.

Each scene is rendered once, and several of the grasps scored there are tried, the policy's own choice first; the
environments that try them render nothing. The folder of trials holds one file per block of scenes, so that an
interrupted recording resumes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from graspbox.envs.coding import Codec
from graspbox.envs.scripted import ScriptedGrasp
from graspbox.evaluation import trial_seeds
from graspbox.learn.training.array_files import ArrayTable, load_or_make_parts
from graspbox.perception.finder import FoundGrasp
from graspbox.policies import DepthGrasp, GraspExecutor, Task
from graspbox.policies.base import SCRIPTED
from graspbox.policies.published.folders import hand_of, read_depth_policy
from graspbox.policies.stability_inputs import STORED_NAME, StabilityInputs, StabilityReading

__all__ = ["BLOCK", "Recorder", "StabilityTrials"]

#: Scenes per file.
BLOCK = 8
#: Tried grasps are among this many of the best; one this many ranks lower is tried 1/e times as often.
_BEST, _RANKS = 160, 60.0
#: Waiting pose of the hand while the camera renders, world_from_hand: over the table, palm down, at its highest.
_WAITING = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.74], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class StabilityTrials(ArrayTable):
    """n grasps: readings (`graspbox.policies.stability_inputs.StabilityReading`), and outcomes of the trials.

    `first` says whether a grasp was the policy's own choice.
    """

    readings: NDArray[np.float32]
    held: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    first: NDArray[np.bool_]

    stored_names: ClassVar = {"readings": STORED_NAME}
    nothing = "no grasp was tried in any scene; the policy finds nothing"


class Recorder:
    """Records trials of the policy in a folder (`DepthGrasp`), with a number of grasps in each scene.

    The sensors are read at `times`, seconds after closing began; the seed determines the scenes, as in
    `graspbox.evaluation.trial_seeds`.
    """

    def __init__(self, policy: Path, objects: str, times: tuple[float, ...], seed: int, per_scene: int) -> None:
        self._policy = DepthGrasp(policy)
        self._seed, self._per_scene = seed, per_scene
        arguments: dict[str, Any] = {
            "objects": objects,
            "hand": hand_of(policy, read_depth_policy(policy)),
            "autoreset_mode": AutoresetMode.DISABLED,
            **SCRIPTED,
            "max_episode_steps": 400,
        }
        self._looking = gymnasium.make_vec(
            "graspbox/Grasp-v0", BLOCK, obs=("depth", "proprio"), **DepthGrasp.settings, **arguments
        )
        task = Task.of(self._looking)
        self._policy.bind(task)
        hand = self._policy.hand
        self._inputs = StabilityInputs(hand, times, self._policy.finder.crop, task.control)
        self._executor = GraspExecutor(task, hand, self._policy.observer.hand_view)
        self._proprio = Codec(task.control, hand, "proprio")
        trying = gymnasium.make_vec("graspbox/Grasp-v0", BLOCK * per_scene, obs=self._inputs.obs, **arguments)
        # Gymnasium's class declares neither seeds per environment nor send and recv.
        self._trying: Any = trying.unwrapped

    def close(self) -> None:
        """Close the environments."""
        self._looking.close()
        self._trying.close()

    def record(
        self,
        folder: Path,
        blocks: int,
        *,
        progress: Callable[[int], None] = lambda _: None,
        stop: Callable[[], bool] = lambda: False,
    ) -> StabilityTrials:
        """Record blocks of `BLOCK` scenes, skipping those whose file exists; raises ConfigError without any grasp."""
        seeds = trial_seeds(self._seed, BLOCK * blocks)

        def record(number: int) -> StabilityTrials:
            return self._block(number, seeds[BLOCK * number : BLOCK * (number + 1)])

        return load_or_make_parts(StabilityTrials, folder, range(blocks), record, progress=progress, stop=stop)

    def _block(self, number: int, seeds: list[int]) -> StabilityTrials:
        """Render each scene, choose grasps and try all of them at once."""
        rng = np.random.default_rng([self._seed, number])
        # The same seed gives the same scene; only the hand's pose and the observations differ.
        rendered, _ = self._looking.reset(seed=seeds, options={"world_from_hand": _WAITING})  # type: ignore[arg-type]
        grasps: dict[int, FoundGrasp] = {}
        for scene, seed in enumerate(seeds):
            # The policy's first random numbers in an episode of this seed: it gets the same noise.
            sampled = int(np.random.default_rng(seed).integers(2**62))
            grasp = self._policy.find(scene, sampled, {"depth": rendered["depth"][scene]})
            if grasp is not None:
                for n, index in enumerate(_chosen(grasp, self._per_scene, rng)):
                    grasps[scene * self._per_scene + n] = grasp.other(index)
        vectors, ends = self._try([seed for seed in seeds for _ in range(self._per_scene)], grasps)
        tried = sorted(vectors)
        size = len(vectors[tried[0]]) if tried else 0
        return StabilityTrials(
            np.array([vectors[env] for env in tried], dtype=np.float32).reshape(len(tried), size),
            np.array([ends[env][0] for env in tried], dtype=np.bool_),
            np.array([ends[env][1] for env in tried], dtype=np.bool_),
            np.array([env % self._per_scene == 0 for env in tried], dtype=np.bool_),
        )

    def _try(
        self, seeds: list[int], grasps: dict[int, FoundGrasp]
    ) -> tuple[dict[int, NDArray[np.float32]], dict[int, tuple[bool, bool]]]:
        """Try a grasp in each environment that has one; returns sensor readings, and success and security."""
        observations, _ = self._trying.reset(seed=seeds)
        drivers: dict[int, ScriptedGrasp] = {}
        for env, grasp in grasps.items():
            start = self._proprio.pose(observations["proprio"][env], "hand")
            drivers[env] = self._executor.grasping(grasp, start)
        readings = {env: StabilityReading(self._inputs, grasp) for env, grasp in grasps.items()}
        ends: dict[int, tuple[bool, bool]] = {}
        active = sorted(drivers)
        while active:
            actions = []
            for env in active:
                driver, now = drivers[env], {name: observations[name][env] for name in self._inputs.obs}
                readings[env].add(driver.time - driver.closes_at, now)
                pose, actuators = (
                    self._proprio.pose(now["proprio"], "hand"),
                    self._proprio.column(now["proprio"], "actuator"),
                )
                actions.append(driver.follow(pose, actuators))
            self._trying.send(np.stack(actions), np.array(active))
            following, _, terminated, truncated, info = self._trying.recv(len(active))
            for row, env in enumerate(info["env_id"].tolist()):
                for name, values in following.items():
                    observations[name][env] = values[row]
                if terminated[row] or truncated[row] or drivers[env].finished:
                    ends[env] = bool(info["is_success"][row]), bool(info["is_secure"][row])
            active = [env for env in active if env not in ends]
        # If the object leaves the table before the fingers have closed, the episode ends without readings.
        vectors = {env: readings[env].vector() for env in ends if readings[env].complete}
        return vectors, ends


def _chosen(grasp: FoundGrasp, count: int, rng: np.random.Generator) -> list[int]:
    """Choose grasps by index: the best, then others sampled from the best ones with decaying probability."""
    order = np.argsort(-grasp.scores, kind="stable")[:_BEST]
    weights = np.exp(-np.arange(1, len(order)) / _RANKS)
    others = min(count, len(order)) - 1
    if others < 1:
        return [int(order[0])]
    picked = rng.choice(len(weights), others, replace=False, p=weights / weights.sum())
    return [int(order[0]), *order[1 + picked].tolist()]
