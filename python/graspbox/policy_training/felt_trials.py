"""Grasps of a policy, felt and then lifted whatever was felt: what a network learns to feel from.

Each scene is looked at once, and several of the grasps that were scored there are tried, the policy's own choice first;
the environments that try them render nothing. A folder of trials holds a file per block of scenes, so that an
interrupted recording continues.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from graspbox.envs.coding import Codec
from graspbox.envs.scripted import ScriptedGrasp
from graspbox.evaluation import trial_seeds
from graspbox.perception.array_files import ArrayTable, load_or_make_parts
from graspbox.perception.finder import FoundGrasp
from graspbox.perception.policy_folders import read_depth_policy
from graspbox.perception.stability import Feeling, StabilityInputs
from graspbox.policies import DepthGrasp, Task

__all__ = ["BLOCK", "FeltTrials", "Recorder"]

#: Scenes of a file.
BLOCK = 8
#: Grasps that are tried are among this many of the best; one this many ranks lower is tried 1/e times as often.
_BEST, _RANKS = 160, 60.0
#: The hand waits here while the camera looks, world_from_hand: over the table, palm down, as high as it goes.
_WAITING = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.74], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class FeltTrials(ArrayTable):
    """n grasps.

    Attributes
    ----------
    felt : (n, k) float32
        What was known and felt (`graspbox.perception.stability.Feeling`).
    held, secure : (n,) bool
        How the trial ended: `graspbox.simulation` defines success and security.
    first : (n,) bool
        Whether it was the policy's own choice.
    """

    felt: NDArray[np.float32]
    held: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    first: NDArray[np.bool_]

    nothing = "no grasp was tried in any scene; the policy finds nothing"


class Recorder:
    """Records trials of a policy.

    Parameters
    ----------
    policy : Path
        Folder of the policy (`DepthGrasp`).
    objects : str
        Object set.
    times : tuple of float
        When the hand feels, seconds after it began to close.
    seed : int
        Determines the scenes, as `graspbox.evaluation.trial_seeds` does.
    per_scene : int
        Grasps of each scene.
    """

    def __init__(self, policy: Path, objects: str, times: tuple[float, ...], seed: int, per_scene: int) -> None:
        self._policy = DepthGrasp(policy)
        self._seed, self._per_scene = seed, per_scene
        given: dict[str, Any] = {
            "objects": objects,
            "hand": read_depth_policy(policy).hand,
            "autoreset_mode": AutoresetMode.DISABLED,
            "max_episode_steps": 400,
        }
        self._looking = gymnasium.make_vec(
            "graspbox/Grasp-v0", BLOCK, obs=("depth", "proprio"), **DepthGrasp.settings, **given
        )
        task = Task.of(self._looking)
        self._policy.bind(task)
        self._inputs = StabilityInputs(self._policy.hand, times, self._policy.crop, task.control)
        self._proprio = Codec(task.control, self._policy.hand, "proprio")
        trying = gymnasium.make_vec("graspbox/Grasp-v0", BLOCK * per_scene, obs=self._inputs.obs, **given)
        # Seeds per environment, send and recv are more than Gymnasium's class knows.
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
        progress: Callable[[int, FeltTrials], None] | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> FeltTrials:
        """Record blocks of scenes, leaving out those whose file is there.

        Parameters
        ----------
        folder : Path
            Where the files are.
        blocks : int
            Number of blocks of `BLOCK` scenes.
        progress : callable, optional
            Called with the number of each block and its trials.
        stop : callable
            Asked before each block that is not there yet; once it says so, no other is recorded.

        Raises
        ------
        ConfigError
            If no scene has a grasp.
        """
        seeds = trial_seeds(self._seed, BLOCK * blocks)

        def record(number: int) -> FeltTrials:
            return self._block(number, seeds[BLOCK * number : BLOCK * (number + 1)])

        return load_or_make_parts(FeltTrials, folder, range(blocks), record, progress=progress, stop=stop)

    def _block(self, number: int, seeds: list[int]) -> FeltTrials:
        """Look at each scene, choose grasps and try all of them at once."""
        rng = np.random.default_rng([self._seed, number])
        # The same seed gives the same scene, with the hand elsewhere and other observations too.
        seen, _ = self._looking.reset(seed=seeds, options={"world_from_hand": _WAITING})  # type: ignore[arg-type]
        grasps: dict[int, FoundGrasp] = {}
        for scene, seed in enumerate(seeds):
            # What the policy draws first in an episode of this seed: it sees the same noise.
            drawn = int(np.random.default_rng(seed).integers(2**62))
            found = self._policy.find(scene, drawn, {"depth": seen["depth"][scene]})
            if found is not None:
                for n, index in enumerate(_chosen(found, self._per_scene, rng)):
                    grasps[scene * self._per_scene + n] = found.other(index)
        felt, ends = self._try([seed for seed in seeds for _ in range(self._per_scene)], grasps)
        tried = sorted(felt)
        size = len(felt[tried[0]]) if tried else 0
        return FeltTrials(
            np.array([felt[env] for env in tried], dtype=np.float32).reshape(len(tried), size),
            np.array([ends[env][0] for env in tried], dtype=np.bool_),
            np.array([ends[env][1] for env in tried], dtype=np.bool_),
            np.array([env % self._per_scene == 0 for env in tried], dtype=np.bool_),
        )

    def _try(
        self, seeds: list[int], grasps: dict[int, FoundGrasp]
    ) -> tuple[dict[int, NDArray[np.float32]], dict[int, tuple[bool, bool]]]:
        """Try a grasp in each environment that has one: what was felt, and success and security."""
        seen, _ = self._trying.reset(seed=seeds)
        drivers: dict[int, ScriptedGrasp] = {}
        for env, found in grasps.items():
            start = self._proprio.pose(seen["proprio"][env], "hand")
            drivers[env] = self._policy.grasping(found, start)
        feelings = {env: Feeling(self._inputs, found) for env, found in grasps.items()}
        ends: dict[int, tuple[bool, bool]] = {}
        active = sorted(drivers)
        while active:
            actions = []
            for env in active:
                driver, now = drivers[env], {name: seen[name][env] for name in self._inputs.obs}
                feelings[env].add(driver.time - driver.closes_at, now)
                actions.append(driver.follow(self._proprio.pose(now["proprio"], "hand")))
            self._trying.send(np.stack(actions), np.array(active))
            following, _, terminated, truncated, info = self._trying.recv(len(active))
            for row, env in enumerate(info["env_id"].tolist()):
                for name, values in following.items():
                    seen[name][env] = values[row]
                if terminated[row] or truncated[row] or drivers[env].finished:
                    ends[env] = bool(info["is_success"][row]), bool(info["is_secure"][row])
            active = [env for env in active if env not in ends]
        # An object that leaves the table before the fingers have closed ends the episode unfelt.
        felt = {env: feelings[env].vector() for env in ends if feelings[env].complete}
        return felt, ends


def _chosen(found: FoundGrasp, count: int, rng: np.random.Generator) -> list[int]:
    """Choose grasps by index: the best, and others among the best, more often the better ones."""
    order = np.argsort(-found.scores, kind="stable")[:_BEST]
    weights = np.exp(-np.arange(1, len(order)) / _RANKS)
    others = min(count, len(order)) - 1
    if others < 1:
        return [int(order[0])]
    picked = rng.choice(len(weights), others, replace=False, p=weights / weights.sum())
    return [int(order[0]), *order[1 + picked].tolist()]
