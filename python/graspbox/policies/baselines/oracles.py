"""Policies with ground truth about the object, to measure the losses of others; **privileged**."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Hand
from graspbox.envs.coding import encode_action, object_pose
from graspbox.errors import ConfigError
from graspbox.perception.configs import DepthNoise, FinderConfig
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.finder import FoundGrasp, GraspFinder, Query, observed_only
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import PoseNoise, perturbed
from graspbox.policies._observer import Observer
from graspbox.policies.base import Task
from graspbox.policies.baselines.planner import KnownObject, KnownObjects, Planner
from graspbox.policies.depth import DepthPolicy
from graspbox.policies.finders import load_finder
from graspbox.policies.published.folders import read_depth_policy
from graspbox.simulation import Scene

__all__ = ["DepthOracle", "Oracle", "RobustOracle", "robust_scores"]

#: A component of a policy of one depth image that ground truth can replace.
Oracle = Literal["completion", "scorer"]
#: Number of the planner's best poses from which `RobustOracle` chooses, and number of successes that are replayed.
_SIMULATED, _FINALISTS = 60, 12


def robust_scores(
    scene: Scene,
    object_from_hand: NDArray[np.float64],
    preshapes: NDArray[np.float64],
    rng: np.random.Generator,
    error: PoseNoise = PoseNoise(0.003, 0.05),  # noqa: B008 (frozen)
    *,
    replays: int = 8,
) -> NDArray[np.float64]:
    """Score grasps (m, 4, 4) by simulation: each once, then 12 successes again with pose errors of the hand.

    Such a finalist scores 0.2 plus the success rate of its replays, plus a hundredth of their rate of secure grasps.
    Other successes score about 0.1, failures 0.
    """
    outcomes = scene.simulate(object_from_hand, preshapes)
    scores = 0.1 * (outcomes.success + 0.01 * outcomes.secure)
    finalists = np.argsort(-scores, kind="stable")[:_FINALISTS]
    finalists = finalists[outcomes.success[finalists]]
    if len(finalists):
        rows = np.repeat(finalists, replays)
        moved = perturbed(object_from_hand[rows], rng, error.position, error.rotation)
        again = scene.simulate(moved, preshapes[rows])
        shares = again.success.reshape(-1, replays).mean(axis=1)
        secure = again.secure.reshape(-1, replays).mean(axis=1)
        scores[finalists] = 0.2 + shares + 0.01 * secure
    return np.asarray(scores, dtype=np.float64)


class DepthOracle(DepthPolicy):
    """A policy of one depth image with components replaced by ground truth, to measure their loss; **privileged**.

    It reads ``state`` and ``info["object"]``, and otherwise acts as `graspbox.policies.DepthGrasp`, with its `noise`
    and
    `config`.

    Parameters
    ----------
    folder : Path or None
        A policy's folder. None: no completion (only the visible surface) and no head, and the scorer must be an oracle.
    oracles : sequence of {"completion", "scorer"}
        Components replaced by ground truth. ``completion``: the object's own occupancy. ``scorer``: simulation of the
        proposals with pose errors of the hand (`robust_scores`); grasps of a refinement score 0.

    Raises
    ------
    ConfigError, FileError
        For an unknown oracle, without any scorer, or for an invalid folder.
    """

    obs = (*DepthPolicy.obs, "state")
    finder: GraspFinder

    def __init__(
        self,
        folder: Path | None,
        oracles: Sequence[Oracle],
        *,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        config: FinderConfig | None = None,
    ) -> None:
        for oracle in oracles:
            if oracle not in get_args(Oracle):
                raise ConfigError(f"there is no oracle {oracle!r}; choose from {', '.join(get_args(Oracle))}")
        if folder is None and "scorer" not in oracles:
            raise ConfigError("there is nothing to score grasps with; name a folder of weights, or the oracle 'scorer'")
        self._oracles = frozenset(oracles)
        published = None if folder is None else read_depth_policy(Path(folder))

        # A rehearsal on the completed shape would overrule what is known.
        settings = (config or (FinderConfig() if published is None else published.finder)).rehearsing(0)

        def finder(hand: Hand) -> GraspFinder:
            if folder is None or published is None:
                return GraspFinder(HandGrid(hand), observed_only, _no_score, settings)
            loaded = load_finder(Path(folder), published, hand, config=settings)
            score = _no_score if "scorer" in oracles else loaded.score
            return GraspFinder(loaded.grid, loaded.complete, score, loaded.config, head=loaded.head)

        super().__init__(partial(Observer, noise=noise), finder)
        if folder is not None and published is not None:
            self._describe(folder, published)

    def _bind(self, task: Task) -> None:
        super()._bind(task)
        self._known, self._names = KnownObjects(task), [""] * task.num_envs

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        super()._begin(env, seed, info)
        self._names[env] = self._known.name_in(info, self.name)

    def find(self, env: int, seed: int, row: Mapping[str, Any]) -> FoundGrasp | None:
        """Find a grasp, as `DepthPolicy.find`; `row` also holds ``state``."""
        mesh, pose = self._known.mesh(self._names[env]), object_pose(row["state"], hand=self.hand)
        finder, simulated = self.finder, False
        view, query = self._asked(row, Query(seed))
        seen = view.seen(finder.crop, num_threads=finder.num_threads)
        frame, rng = seen.crops.world_from_crop[0], np.random.default_rng([seed, 1])

        def complete(channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
            del channels
            return solid_occupancy([mesh], [0], (np.linalg.inv(frame) @ pose)[None], config=finder.crop)

        def score(
            volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
        ) -> NDArray[np.float64]:
            nonlocal simulated
            if simulated:
                return np.zeros(len(preshapes))
            simulated = True
            scene = Scene(mesh, hand=self.hand, world_from_object=pose)
            object_from_hand = np.linalg.inv(scene.world_from_object) @ frame @ poses
            return robust_scores(scene, object_from_hand, preshapes, rng)

        known = GraspFinder(
            finder.grid,
            complete if "completion" in self._oracles else finder.complete,
            score if "scorer" in self._oracles else finder.score,
            finder.config,
            head=finder.head,
        )
        return known.find(seen, query)


def _no_score(
    volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stand for a scorer that an oracle replaces; never called."""
    raise ConfigError("the policy has no scorer; name a folder of weights")


class RobustOracle(Planner):
    """Chooses the planner's pose that succeeds most often under pose errors of the hand; **privileged**.

    It simulates each of the 60 best-ranked poses once, and up to 12 successes 16 times with errors of 5 mm and 5
    degrees along and about each axis of the hand. It bounds the gain from a better choice among the planner's poses.
    """

    name = "robust_oracle"
    env_id = "graspbox/GraspPose-v0"
    _error = PoseNoise(0.005, float(np.radians(5.0)))

    def _bind(self, task: Task) -> None:
        if task.closed_loop:
            raise ConfigError(f"the policy {self.name!r} acts in graspbox/GraspPose-v0, not in {task.env_id!r}")
        if task.layout != "single":
            raise ConfigError(f"layout is {task.layout!r}, but the policy {self.name!r} simulates a single object")
        if task.arm is not None:
            raise ConfigError(f"the policy {self.name!r} bounds what a hand without an arm can do; leave arm out")
        super()._bind(task)

    def _decide(self, subject: KnownObject, state: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Choose among the feasible poses of the planner."""
        mesh = subject.mesh
        pose = object_pose(state, hand=self._hand)
        plan = planning.plan(mesh, hand=self._hand, world_from_object=pose).best(_SIMULATED)
        if not len(plan):
            return None
        scene = Scene(mesh, hand=self._hand, world_from_object=pose)
        object_from_hand = np.linalg.inv(scene.world_from_object) @ pose @ plan.poses
        # The same scene has the same replays, independent of the other environments.
        rng = np.random.default_rng(np.frombuffer(state.tobytes(), dtype=np.uint32))
        scores = robust_scores(scene, object_from_hand, plan.preshape, rng, self._error, replays=16)
        best = int(np.argmax(scores))
        return encode_action(pose @ plan.poses[best], plan.preshape[best], hand=self._hand)
