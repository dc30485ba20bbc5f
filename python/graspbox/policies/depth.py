"""Grasps from one depth image: `DepthPolicy`, and `DepthGrasp` with published networks."""

import os
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from graspbox._common.made_once import MadeOnce
from graspbox._core import Hand
from graspbox.captures import Capture
from graspbox.envs import IDS
from graspbox.errors import ConfigError
from graspbox.hands import HandLike
from graspbox.perception.configs import DepthNoise, FinderConfig
from graspbox.perception.depth_views import DepthView
from graspbox.perception.finder import Finder, FoundGrasp, GraspFinder, Query
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies._executor import Executor, GraspExecutor, executor_of
from graspbox.policies._hand_view import HandView
from graspbox.policies._observer import Observer
from graspbox.policies.arm_reach import ABOVE, ArmAt
from graspbox.policies.base import SCRIPTED, Actions, SeededPolicy, Task
from graspbox.policies.finders import check_backend, load_finder
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps, SceneGrasps
from graspbox.policies.published.configs import DepthPolicyConfig, PolicyConfig
from graspbox.policies.published.folders import hand_of, read_depth_policy
from graspbox.policies.published.runtimes import Backend
from graspbox.simulation import load_hand
from graspbox.simulation.layouts import bin_points

__all__ = ["DepthGrasp", "DepthPolicy", "load_finder"]

#: Label of the object to grasp in segmentations.
_TARGET = 2
#: Number of last attempts in a scene that are not repeated.
_REMEMBERED = 5


class DepthPolicy(SeededPolicy):
    """Grasps the object in one depth image: an observer looks, a finder chooses, an executor moves the hand.

    If one of several objects is the target, its pixels in the segmentation (label 2) mark it. A bin's place and size
    are
    known, and grasps keep off its walls if any can. It looks once per episode, and before every attempt in
    ``Clear-v0``.
    There and in ``GraspPose-v0`` the grasp is the action: on an arm, the best to which it has a path among what is seen
    (extra ``arm``). In ``Grasp-v0`` the hand first leaves the image, and then
    moves
    to the grasp as the scripted expert does. Without an object or a grasp, its actions are zeros.

    Parameters
    ----------
    observer, finder, executor : callable
        Make, when the policy is bound, an `Observer` of `Task` and `Hand`, a `graspbox.perception.Finder` of `Hand`,
        and
        an executor of `Task`, `Hand` and `Observer.hand_view`: by default a `PoseExecutor` in ``GraspPose-v0``, and a
        `GraspExecutor` in ``Grasp-v0``. The parts are attributes once it is bound.

    Attributes
    ----------
    found : list of FoundGrasp or None
        The last grasp in each environment; None without one.
    """

    name = "depth"
    obs: tuple[str, ...] = ("depth", "proprio")
    target_obs = ("segmentation",)
    settings: Mapping[str, Any] = {"image_size": 128}
    closed_loop_settings = SCRIPTED
    _names_poses = True
    hand: Hand
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

    def _describe(self, folder: str | os.PathLike[str], published: PolicyConfig) -> None:
        """Take name, training sets and hand of a published policy."""
        self.name, self.learned_from = published.name, published.learned_from
        self.settings = {**self.settings, "hand": hand_of(folder, published)}

    def _bind(self, task: Task) -> None:
        self.hand = load_hand(task.hand)
        self.observer = self._make_observer(task, self.hand)
        self.finder = self._make_finder(self.hand)
        self._walls = None if task.bin_size is None else bin_points(task.bin_size)
        self.executor = self._make_executor(task, self.hand, self.observer.hand_view)
        self.found = [None] * task.num_envs
        #: Seed of each environment's pending look, and the attempts in its scene that failed.
        self._waiting: list[int | None] = [None] * task.num_envs
        self._failed: list[tuple[FoundGrasp, ...]] = [()] * task.num_envs
        self._clears = task.env_id == IDS[2]
        self._arm = task.arm_at()
        self._needed = (*self.obs, *(self.target_obs if task.has_target else ()))

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        super()._begin(env, seed, info)
        self.executor.begin(env)
        self._failed[env] = ()
        self._wait(env)

    def _wait(self, env: int) -> None:
        """Schedule another look, as soon as the executor is ready."""
        self._waiting[env] = int(self._streams[env].integers(2**62))

    def act(self, observation: Any) -> Actions:
        """Choose grasps in environments that are ready; continue the motion in the others."""
        actions = self._zeros()
        for env in range(self.task.num_envs):
            if self._clears and self._waiting[env] is None:
                # What failed would fail again; where an attempt succeeded, nothing is left.
                if (last := self.found[env]) is not None:
                    self._failed[env] = (*self._failed[env], last)[-_REMEMBERED:]
                self._wait(env)
            row = {name: observation[name][env] for name in self._needed}
            if self._waiting[env] is not None and self.executor.ready(env, row):
                self.executor.start(env, self._look(env, row), row)
            action = self.executor.act(env, row)
            if action is not None:
                actions[env] = action
        return actions

    def find(self, env: int, seed: int, row: Mapping[str, Any]) -> FoundGrasp | None:
        """Look and choose in one environment, without moving; None without a grasp.

        `seed` is that of the camera's noise and of the refinement, `row` the environment's row of the observations.
        """
        target = row["segmentation"][..., 0] == _TARGET if self.task.has_target else None
        view, query = self._asked(row, Query(seed, target, self._walls, self._failed[env]))
        return self.finder.find(view, query)

    def _asked(self, row: Mapping[str, Any], query: Query) -> tuple[DepthView, Query]:
        """Take the image that a row of the observations holds, and complete a query by what an arm can carry out."""
        view = self.observer.look(row, query.seed)
        if self._arm is None:
            return view, query
        arm, base, config = self._arm
        at = ArmAt(arm, base)
        view = at.hidden(self.hand, view)
        points = view.points()
        return view, replace(query, carried=partial(at.carried, self.hand, points[points[:, 2] > ABOVE], config))

    def _look(self, env: int, row: Mapping[str, Any]) -> FoundGrasp | None:
        """Look with the pending seed."""
        seed, self._waiting[env] = self._waiting[env], None
        assert seed is not None
        self.found[env] = self.find(env, seed, row)
        return self.found[env]

    def retry(self, env: int, row: Mapping[str, Any]) -> None:
        """Release the current grasp in ``Grasp-v0``, look again, and execute a grasp unlike it."""
        grasp = self.found[env]
        assert isinstance(self.executor, GraspExecutor)
        assert grasp is not None
        self.executor.release(env, grasp, row)
        self._failed[env] = (grasp,)
        self._wait(env)

    def confidence(self, env: int) -> float | None:
        """Return the probability that the grasp succeeds: 0 without a grasp, None if the finder states none."""
        if (grasp := self.found[env]) is None:
            return 0.0 if self.finder.states_success else None
        return grasp.success

    def found_nothing(self, env: int) -> bool:
        """Whether its last look at an environment found no grasp."""
        return self._waiting[env] is None and self.found[env] is None


class DepthGrasp(DepthPolicy):
    """Grasps the object in one depth image, with published networks (`graspbox.perception.GraspFinder`).

    Copies share the networks, which are loaded when the first of them is bound, and may act in different threads.

    Parameters
    ----------
    folder : Path
        A policy's folder (`graspbox.policies.published.folders`).
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    config : FinderConfig, optional
        Settings of the search for grasps, a rehearsal of single objects only; by default those of the folder.
    hand_error : PoseNoise, optional
        Expected error of the hand's pose: grasps that tolerate it are chosen. A decision then takes several times as
        long.
    rehearsed : int, optional
        How many of the best grasps are first tried in simulation on the completed shape
        (`graspbox.perception.configs.RehearsalConfig`), 0 for none; by default as in the folder, and none where there
        are several objects. A decision then takes several times as long.
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

    #: The class of its ``config.json``, `graspbox.policies.published.registry`.
    config_class = DepthPolicyConfig
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
        check_backend(backend)
        published = read_depth_policy(Path(folder))
        settings = Query(hand_error=hand_error, rehearsed=rehearsed).settings(config or published.finder)
        self._rehearsed = rehearsed
        load = partial(load_finder, Path(folder), published, config=settings, backend=backend, num_threads=num_threads)
        super().__init__(partial(Observer, noise=noise), MadeOnce(load))
        self._describe(folder, published)
        self._grasper = MadeOnce(partial(_grasper, Path(folder), backend, num_threads))

    def grasps(
        self, capture: Capture, *, label: int | None = None, hand: HandLike | None = None, **options: Any
    ) -> ImageGrasps:
        """Find grasps in a depth image of a real camera, without an environment.

        Parameters
        ----------
        capture : Capture
            The image (`graspbox.captures.read_capture`); its labels name the thing, its pose the table.
        label : int, optional
            The thing, if the capture has labels of several.
        hand : str, Hand or pair of paths, optional
            The hand, for a policy that grasps with any.
        **options
            Those of `graspbox.policies.grasp_image.ImageOptions`, but for the mask; and ``table_from_camera`` instead
            of the capture's.

        Raises
        ------
        ConfigError
            As `graspbox.policies.grasp_image.ImageGrasper.find`, or if the label is unknown.
        """
        mask = None if capture.labels is None else capture.mask(label)
        place = (capture.depth, capture.intrinsics, options.pop("table_from_camera", capture.table_from_camera))
        found = self._grasper(hand).find(*place, mask=mask, **options)
        return replace(found, warnings=(*capture.warnings, *found.warnings))

    def grasps_of_things(self, capture: Capture, *, hand: HandLike | None = None, **options: Any) -> SceneGrasps:
        """Find grasps of every thing in a depth image, those of its labels if it has some; otherwise as `grasps`."""
        place = (capture.depth, capture.intrinsics, options.pop("table_from_camera", capture.table_from_camera))
        return self._grasper(hand).find_all(*place, labels=capture.labels, **options)

    def _bind(self, task: Task) -> None:
        super()._bind(task)
        if self.finder.config.rehearsal is None or (task.layout == "single" and not self._clears):
            return
        if self._rehearsed is not None:
            raise ConfigError(
                f"the policy {self.name!r} rehearses grasps of a single object, and {task.env_id!r} has the layout "
                f"{task.layout!r}; let it rehearse none (rehearsed=0, --rehearse 0)"
            )
        # Copies of the policy share the finder.
        self.finder = copy(self.finder)
        self.finder.config = self.finder.config.rehearsing(0)


def _grasper(folder: Path, backend: Backend, num_threads: int | None, hand: HandLike | None) -> ImageGrasper:
    return ImageGrasper(folder, hand=hand, backend=backend, num_threads=num_threads)
