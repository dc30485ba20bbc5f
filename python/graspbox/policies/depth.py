"""Grasps from one depth image, without mesh or true pose: `DepthPolicy`, and `DepthGrasp` with published networks."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from graspbox._common.made_once import MadeOnce
from graspbox._core import Hand
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import hand_of, read_depth_policy
from graspbox.artifacts.runtimes import Backend, load_parts
from graspbox.envs import IDS
from graspbox.errors import ConfigError
from graspbox.layouts import bin_points
from graspbox.perception.configs import DepthNoise, FinderConfig
from graspbox.perception.finder import Finder, FoundGrasp, GraspFinder
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies._executor import Executor, GraspExecutor, executor_of
from graspbox.policies._hand_view import HandView
from graspbox.policies._observer import Observer
from graspbox.policies.base import Actions, Policy, Task
from graspbox.simulation import load_hand

__all__ = ["DepthGrasp", "DepthPolicy", "load_finder"]

#: Label of the object to grasp in segmentations.
_TARGET = 2
#: Number of last attempts in a scene that are not repeated.
_REMEMBERED = 5


class DepthPolicy(Policy):
    """Grasps the object in one depth image: an observer looks, a finder chooses, an executor moves the hand.

    Where one of several objects is the target, its pixels in the segmentation (label 2) tell which. A bin's place and
    size are known, and grasps keep off its walls where they can. It looks once per episode, and before every attempt in
    ``Clear-v0``. There and in ``GraspPose-v0`` the grasp is the
    action. In ``Grasp-v0`` the hand first leaves the image, and then moves to the grasp as the scripted expert does.
    Where no object is seen or no grasp is found, its actions are zeros.

    Parameters
    ----------
    observer : callable
        Makes an `Observer` of `Task` and `Hand`, such as the class itself. All three are called when the policy is
        bound.
    finder : callable
        Makes a `graspbox.perception.Finder` of `Hand`.
    executor : callable
        Makes an executor of `Task`, `Hand` and `Observer.hand_view`; by default a `PoseExecutor` in ``GraspPose-v0``,
        and a `GraspExecutor` in ``Grasp-v0``.

    Attributes
    ----------
    hand, observer, finder, executor
        The parts, once the policy is bound.
    needed : tuple of str
        Observations that it reads, once the policy is bound.
    found : list of FoundGrasp or None
        The last grasp found in each environment; None where none was.
    """

    name = "depth"
    obs: tuple[str, ...] = ("depth", "proprio")
    target_obs = ("segmentation",)
    settings: Mapping[str, Any] = {"image_size": 128}
    hand: Hand
    needed: tuple[str, ...]
    observer: Observer
    finder: Finder
    executor: Executor

    def __init__(
        self,
        observer: Callable[[Task, Hand], Observer],
        finder: Callable[[Hand], Finder],
        executor: Callable[[Task, Hand, HandView], Executor] = executor_of,
    ) -> None:
        self._make_observer, self._make_finder, self._make_executor = observer, finder, executor
        self.found: list[FoundGrasp | None] = []

    def _bind(self, task: Task) -> None:
        self.hand = load_hand(task.hand)
        self.observer = self._make_observer(task, self.hand)
        self.finder = self._make_finder(self.hand)
        if task.bin_size is not None:
            self.finder = self.finder.keeping_off(bin_points(task.bin_size))
        self.executor = self._make_executor(task, self.hand, self.observer.hand_view)
        self.found = [None] * task.num_envs
        self._streams = [np.random.default_rng() for _ in range(task.num_envs)]
        #: Seed of each environment's pending look, and the finder that then chooses.
        self._waiting: list[int | None] = [None] * task.num_envs
        self._finders = [self.finder] * task.num_envs
        self._tried: list[tuple[FoundGrasp, ...]] = [()] * task.num_envs
        self._clears = task.env_id == IDS[2]
        self.needed = (*self.obs, *(self.target_obs if task.has_target else ()))

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        if seed is not None:
            self._streams[env] = np.random.default_rng(seed)
        del info
        self.executor.begin(env)
        self._tried[env] = ()
        self._wait(env, self.finder)

    def _wait(self, env: int, finder: Finder) -> None:
        """Schedule another look, as soon as the executor is ready."""
        self._waiting[env], self._finders[env] = int(self._streams[env].integers(2**62)), finder

    def act(self, observation: Any) -> Actions:
        """Choose grasps in environments that are ready; continue the motion in the others."""
        actions = self._zeros()
        for env in range(self.task.num_envs):
            if self._clears and self._waiting[env] is None:
                self._wait(env, self._other_than(env))
            row = {name: observation[name][env] for name in self.needed}
            if self._waiting[env] is not None and self.executor.ready(env, row):
                self.executor.start(env, self._look(env, row), row)
            action = self.executor.act(env, row)
            if action is not None:
                actions[env] = action
        return actions

    def _other_than(self, env: int) -> Finder:
        """Give a finder for the attempt after others in the same scene.

        What failed would fail again; where an attempt succeeded, nothing is left.
        """
        last = self.found[env]
        if last is None or not isinstance(self.finder, GraspFinder):
            return self.finder
        self._tried[env] = (*self._tried[env], last)[-_REMEMBERED:]
        return self.finder.avoiding(*self._tried[env])

    def find(self, env: int, seed: int, row: Mapping[str, Any]) -> FoundGrasp | None:
        """Look and choose in one environment, without moving; None where no grasp is found.

        `seed` is that of the camera's noise and of the refinement, `row` the environment's row of the observations.
        """
        target = row["segmentation"][..., 0] == _TARGET if self.task.has_target else None
        return self._finders[env].find(self.observer.look(row, seed), seed=seed, target=target)

    def _look(self, env: int, row: Mapping[str, Any]) -> FoundGrasp | None:
        """Look with the pending seed."""
        seed, self._waiting[env] = self._waiting[env], None
        assert seed is not None
        self.found[env] = self.find(env, seed, row)
        return self.found[env]

    def has_looked(self, env: int) -> bool:
        """Whether it has looked in the current episode of an environment."""
        return self._waiting[env] is None

    def look(self, env: int, row: Mapping[str, Any]) -> None:
        """Look in ``Grasp-v0`` without moving, once per episode, if the hand is out of the image."""
        assert isinstance(self.executor, GraspExecutor)
        if not self.has_looked(env) and not self.executor.sees_hand(row):
            self._look(env, row)

    def retry(self, env: int, row: Mapping[str, Any], finder: Finder) -> None:
        """Release the current grasp in ``Grasp-v0``, look again, and execute the choice of another finder."""
        found = self.found[env]
        assert isinstance(self.executor, GraspExecutor)
        assert found is not None
        self.executor.release(env, found, row)
        self._wait(env, finder)

    def confidence(self, env: int) -> float | None:
        """Give the finder's probability of success; 0 where no grasp was found, None where it has none."""
        return self.finder.confidence(self.found[env])

    def found_nothing(self, env: int) -> bool:
        """Whether its last look at an environment saw no object or found no grasp."""
        return self.has_looked(env) and self.found[env] is None


class DepthGrasp(DepthPolicy):
    """Grasps the object in one depth image, with published networks (`graspbox.perception.GraspFinder`).

    Copies share the networks, which are loaded when the first of them is bound, and may act in different threads.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.artifacts.folders`).
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    config : FinderConfig, optional
        Settings of the search for grasps; by default those of the folder.
    hand_error : PoseNoise, optional
        Expected error of the hand's pose: grasps that tolerate it are chosen. A decision then takes several times as
        long.
    rehearsed : int, optional
        How many of the best grasps are first tried in simulation on the completed shape
        (`graspbox.perception.configs.RehearsalConfig`), 0 for none; by default as in the folder. A decision then takes
        several times as long. For single objects.
    backend : {"onnx", "torch"}
        Runs the networks: onnxruntime (extra ``onnx``), or torch.
    num_threads : int, optional
        Threads of a decision; by default one per core. Geometry does not depend on it; networks differ in the last
        digits.

    Raises
    ------
    ConfigError
        For an unknown backend, or if the folder is wrong or lacks a file.
    """

    finder: GraspFinder

    def __init__(
        self,
        folder: Path,
        *,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        config: FinderConfig | None = None,
        hand_error: PoseNoise | None = None,
        rehearsed: int | None = None,
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        _check_backend(backend)
        published = read_depth_policy(Path(folder))
        settings = config or published.finder
        if hand_error is not None:
            settings = settings.tolerating(hand_error)
        if rehearsed is not None:
            settings = settings.rehearsing(rehearsed)
        load = partial(load_finder, Path(folder), published, config=settings, backend=backend, num_threads=num_threads)
        super().__init__(partial(Observer, noise=noise), MadeOnce(load))
        self.name, self.learned_from = published.name, published.learned_from
        self.settings = {**self.settings, "hand": hand_of(folder, published)}

    def _bind(self, task: Task) -> None:
        super()._bind(task)
        if self.finder.config.rehearsal is not None and (self._clears or task.layout != "single"):
            raise ConfigError(
                f"the policy {self.name!r} rehearses grasps of a single object, and {task.env_id!r} has the layout "
                f"{task.layout!r}; let it rehearse none (rehearsed=0, --rehearse 0)"
            )


def load_finder(
    folder: Path,
    published: DepthPolicyConfig,
    hand: Hand,
    *,
    config: FinderConfig | None = None,
    backend: Backend = "onnx",
    num_threads: int | None = None,
) -> GraspFinder:
    """Load the finder of a published policy; `published` is its config, other parameters are those of `DepthGrasp`.

    Raises
    ------
    ConfigError
        For a hand other than the policy's, or an unknown backend.
    """
    settings, finder = published.settings_for(hand, config)
    _check_backend(backend)
    grid = HandGrid(hand, settings, crop=published.crop, num_threads=num_threads)
    parts = load_parts(folder, published, grid, backend, num_threads)
    return GraspFinder(grid, parts.complete, parts.scorer, finder, head=parts.head)


def _check_backend(backend: str) -> None:
    if backend not in get_args(Backend):
        raise ConfigError(f"there is no backend {backend!r}; choose from {', '.join(get_args(Backend))}")
