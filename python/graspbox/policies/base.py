"""`Policy`, the interface of all policies, and `Task`, the environments that one acts in."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Self, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._common.arguments import config_of, floats
from graspbox.arms import Arm, load_arm
from graspbox.configs import PathConfig, TrialConfig
from graspbox.configs.cameras import CamerasConfig
from graspbox.envs import GOAL_IDS, IDS, SINGLE_OBJECT_IDS
from graspbox.envs.settings import (
    ClearConfig,
    GraspConfig,
    GraspPoseConfig,
    HandArgument,
    ObjectsArgument,
    kind_of,
)
from graspbox.errors import ConfigError
from graspbox.simulation.layouts import Arrangement, SceneLayout

__all__ = ["SCRIPTED", "Actions", "Policy", "SeededPolicy", "Task", "cameras_of", "is_closed_loop"]

#: Least length of a straight line of a path, metres.
_SHORTEST = 0.001
#: (num_envs, k) float32.
Actions = NDArray[np.float32]
#: Keywords of ``Grasp-v0`` for policies that move the hand by scripted motions: `Policy.closed_loop_settings`.
SCRIPTED: Mapping[str, Any] = MappingProxyType({"fingers": "each", "control_freq": 20.0, "max_episode_steps": 200})


@dataclass(frozen=True)
class Task:
    """The environments that a policy acts in.

    Attributes
    ----------
    env_id : str
        Registered id: one of `graspbox.envs.IDS`, or of the goal tasks `GOAL_IDS`.
    num_envs : int
        Number of environments; rows of observations and actions.
    observation_space, action_space : Space
        Of one environment.
    obs : str or tuple of str
        Keyword ``obs`` of the environments: names of the observations. Several names make a mapping.
    sets : str, Path, ObjectSet or sequence of str
        Keyword ``objects`` of the environments.
    scale, mass, split, control, fingers, control_freq, hand, cameras, layout, bin_size
        Keywords of the environments; `cameras` with the size of their images, `bin_size` None for layouts without a
        bin.
    arm : Arm, optional
        The arm that carries the hand in decisions.
    world_from_arm : (4, 4) float64, optional
        Pose of its base; None if neither the environments nor their keywords tell it.
    trial : TrialConfig
        The trial that follows its decisions.
    scenes : callable, optional
        Returns the scene of each environment by its index, for **privileged** policies; None for a single object in
        ``GraspPose-v0`` or ``Grasp-v0``, and for observations that come from a client.
    """

    env_id: str
    num_envs: int
    observation_space: gymnasium.Space[Any]
    action_space: spaces.Box
    obs: str | tuple[str, ...]
    sets: ObjectsArgument
    scale: float
    mass: float | None
    split: object_sets.Split | None
    control: str
    fingers: str
    control_freq: float
    hand: HandArgument
    cameras: CamerasConfig
    layout: SceneLayout = "single"
    bin_size: Sequence[float] | None = None
    arm: Arm | None = None
    world_from_arm: NDArray[np.float64] | None = field(default=None, compare=False)
    trial: TrialConfig = TrialConfig()  # noqa: RUF009 (frozen)
    scenes: Callable[[int], Arrangement] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(cls, envs: VectorEnv[Any, Any, Any] | gymnasium.Env[Any, Any]) -> Self:
        """Describe environments that ``gymnasium.make_vec`` or ``gymnasium.make`` made.

        A single environment counts as one row: pass the policy ``observation[None]`` and step ``action[0]``.

        Raises
        ------
        ConfigError
            If they are not graspbox's, or were made without a registered id.
        """
        spec = envs.spec
        if spec is None or spec.id not in (*IDS, *GOAL_IDS):
            shown = "no registered id" if spec is None else f"the id {spec.id!r}"
            raise ConfigError(f"the environments have {shown}; make one of {', '.join((*IDS, *GOAL_IDS))} by its id")
        if isinstance(envs, VectorEnv):
            num_envs, observation_space = envs.num_envs, envs.single_observation_space
            action_space = envs.single_action_space
        else:
            num_envs, observation_space, action_space = 1, envs.observation_space, envs.action_space
        if not isinstance(action_space, spaces.Box):
            raise ConfigError(f"the action space is {action_space}; policies need a Box")
        names = ("obs", "scale", "mass", "split", "control", "fingers", "control_freq", "hand")
        kinds = kind_of(spec.id, vector=True), GraspPoseConfig, GraspConfig
        defaults = {name: next(getattr(kind, name) for kind in kinds if hasattr(kind, name)) for name in names}
        values = {name: spec.kwargs.get(name, value) for name, value in defaults.items()}
        values["obs"] = values["obs"] if isinstance(values["obs"], str) else tuple(values["obs"])
        values |= {"sets": spec.kwargs.get("objects", "procedural"), "cameras": cameras_of(spec.kwargs)}
        clears = spec.id.startswith("graspbox/Clear-")
        layout = values["layout"] = spec.kwargs.get("layout", kinds[0].layout)
        if layout == "bin":
            values["bin_size"] = spec.kwargs.get("bin_size", ClearConfig.bin_size)
        if (arm := spec.kwargs.get("arm")) is not None and not is_closed_loop(spec.id):
            values |= {"arm": load_arm(arm), "world_from_arm": _base_of(envs, spec.kwargs.get("base"))}
            trial = spec.kwargs.get("trial") or TrialConfig()
            values["trial"] = config_of(TrialConfig, trial, "trial") if isinstance(trial, Mapping) else trial
        scenes = _Scenes(envs) if clears or layout != "single" else None
        return cls(spec.id, num_envs, observation_space, action_space, **values, scenes=scenes)

    @property
    def has_target(self) -> bool:
        """Whether one of several objects is to be grasped."""
        return self.layout != "single" and self.env_id in SINGLE_OBJECT_IDS

    @cached_property
    def objects(self) -> object_sets.ObjectSet:
        """The objects that may appear; raises as `graspbox.object_sets.load` if they are not on this machine."""
        return object_sets.load(self.sets, scale=self.scale, mass=self.mass, split=self.split)

    def scene(self, env: int, policy: str) -> Arrangement:
        """Return an environment's scene for the named policy, **privileged**; raises ConfigError if unknown."""
        if self.scenes is None:
            raise ConfigError(
                f"the policy {policy!r} sees no scene; bind it to several objects in environments of this process"
            )
        return self.scenes(env)

    def arm_at(self) -> tuple[Arm, NDArray[np.float64], PathConfig] | None:
        """Return the arm of decisions, the pose of its base, and settings of its paths to them; None without an arm.

        Raises ConfigError if the base is not known.
        """
        if self.arm is None:
            return None
        if self.world_from_arm is None:
            raise ConfigError("the environments do not tell where the arm stands; pass base, the pose of its base")
        standoff, lift = (min(max(x, _SHORTEST), 1.0) for x in (self.trial.standoff, self.trial.lift_height))
        return self.arm, self.world_from_arm, PathConfig(standoff=standoff, lift=lift)

    @property
    def closed_loop(self) -> bool:
        """Whether an episode is many actions (``Grasp-v0``, goal tasks), not one decision (``GraspPose-v0``)."""
        return is_closed_loop(self.env_id)


def is_closed_loop(env_id: str) -> bool:
    """Whether an episode of these environments is many actions, not one decision or several."""
    return not env_id.removeprefix("graspbox:").startswith(("graspbox/GraspPose-", "graspbox/Clear-"))


def _base_of(envs: Any, base: Any) -> NDArray[np.float64] | None:
    """Return the pose of an arm's base, as given, or as the environments tell it."""
    if base is not None:
        return floats(base, "base")
    with contextlib.suppress(AttributeError, ConfigError):  # of gymnasium's own vector environments, and remote ones
        return cast(NDArray[np.float64] | None, envs.unwrapped.world_from_arm)
    return None


@dataclass(frozen=True)
class _Scenes:
    """The scenes of environments, single or vector."""

    envs: Any

    def __call__(self, env: int) -> Arrangement:
        if isinstance(self.envs, VectorEnv):
            return cast(Arrangement, self.envs.unwrapped.arrangement(env))  # type: ignore[attr-defined]
        return cast(Arrangement, self.envs.unwrapped.arrangement())


def cameras_of(arguments: Mapping[str, Any]) -> CamerasConfig:
    """Return the cameras that the keywords ``cameras`` and ``image_size`` of environments describe.

    Raises ConfigError if ``cameras`` is a mapping with a wrong entry.
    """
    given = arguments.get("cameras", GraspConfig.cameras)
    cameras: CamerasConfig = config_of(CamerasConfig, given, "cameras") if isinstance(given, Mapping) else given
    size = arguments.get("image_size", GraspConfig.image_size)
    if size is not None:
        rows_columns = (size, size) if np.ndim(size) == 0 else tuple(size)
        cameras = replace(cameras, image_size=rows_columns)
    return cameras


class Policy(ABC):
    """Chooses the actions of many environments at once.

    `bind` comes first, once. Then `reset` is called for every episode that begins, with the info of that reset, before
    `act` sees its first observation; ``mask`` marks the environments that begin one, as the option
    ``reset_mask`` of a reset does. With autoreset, call it after the step that began the episodes: the step that ended
    the last ones (``AutoresetMode.SAME_STEP``) or the one after it (``AutoresetMode.NEXT_STEP``).

    A subclass implements `act`, and `_bind` and `_begin` if it keeps a state per environment. Its actions in an
    environment must depend only on that environment's seeds, infos and observations; then results do not depend on
    `Task.num_envs`.

    Attributes
    ----------
    name : str
        Name in results.
    obs : str, tuple of str or None
        Observations that the policy needs (as the keyword ``obs`` of the environments names them); None: any.
    target_obs : tuple of str
        Further observations that it needs if one of several objects is the target (`Task.has_target`).
    settings : mapping
        Other keywords of environments that suit it, the defaults of `graspbox.evaluation.evaluate`.
    closed_loop_settings : mapping
        Further keywords that suit it in ``Grasp-v0``.
    env_id : str or None
        The one environment that it acts in; None: any.
    learned_from : tuple of str
        Object sets from which it learned, ``NAME`` or ``NAME/SPLIT``, whose objects `graspbox.evaluation.evaluate`
        leaves
        out.
    held_out : pair of tuple of str and str, or None
        Object sets of its training, and the split of them on which `graspbox.evaluation.evaluate` measures it by
        default; None: all of ``procedural``.
    base : Policy or None
        A policy that this one builds on. Episodes begin in it too; `_bind` binds it.
    """

    name: str = "policy"
    obs: str | tuple[str, ...] | None = None
    target_obs: tuple[str, ...] = ()
    settings: Mapping[str, Any] = {}
    closed_loop_settings: Mapping[str, Any] = {}
    env_id: str | None = None
    learned_from: tuple[str, ...] = ()
    held_out: tuple[tuple[str, ...], object_sets.Split] | None = None
    base: "Policy | None" = None
    _task: Task | None = None
    #: Whether depth must be in metres.
    _needs_metres: ClassVar[bool] = True
    #: Whether its decisions are poses of the hand.
    _names_poses: ClassVar[bool] = False

    @property
    def task(self) -> Task:
        """The environments that it is bound to; raises ConfigError before `bind`."""
        if self._task is None:
            raise ConfigError(f"the policy {self.name!r} is not bound to environments; call bind(Task.of(envs)) first")
        return self._task

    def needed_obs(self, *, target: bool) -> str | tuple[str, ...] | None:
        """Return the observations that it needs: `obs`, and `target_obs` if one of several objects is the target."""
        more = self.target_obs or (() if self.base is None else self.base.target_obs)
        if not target or not more:
            return self.obs
        return (*((self.obs,) if isinstance(self.obs, str) else self.obs or ()), *more)

    def settings_in(self, env_id: str) -> dict[str, Any]:
        """Return the keywords of environments with this id that suit it."""
        return {**(self.closed_loop_settings if is_closed_loop(env_id) else {}), **self.settings}

    def default_objects(self, split: object_sets.Split | None = None) -> tuple[list[str], object_sets.Split | None]:
        """Return the object sets, and their split, where none are named: `held_out`, else ``procedural``."""
        objects, other = self.held_out or (("procedural",), None)
        return list(objects), split or other

    def bind(self, task: Task) -> None:
        """Prepare for environments; binding to others forgets everything about the former ones.

        Raises
        ------
        ConfigError
            If the policy cannot act there, or an observation that it needs is missing.
        """
        observed = (task.obs,) if isinstance(task.obs, str) else task.obs
        needed = self.needed_obs(target=task.has_target)
        names = set((needed,) if isinstance(needed, str) else needed or ())
        if not names <= set(observed):
            raise ConfigError(f"the policy {self.name!r} needs obs={needed!r}; the environments have obs={task.obs!r}")
        space = task.observation_space
        boxes = space.spaces if isinstance(space, spaces.Dict) else {observed[0]: space}
        if task.env_id in GOAL_IDS:
            boxes = {observed[0]: boxes["observation"]}
        seen_as_bytes = (name for name in names if name.partition("_")[0] == "depth" and boxes[name].dtype == np.uint8)
        if self._names_poses and task.control == "grasp_point":
            raise ConfigError(f"the policy {self.name!r} names poses; make environments with control='grasp_pose'")
        if self._needs_metres and any(seen_as_bytes):
            raise ConfigError(f"the policy {self.name!r} needs depth in metres; make environments without depth_limits")
        self._task = task
        self._bind(task)

    def reset(
        self,
        seed: int | Sequence[int | None] | None = None,
        *,
        mask: NDArray[np.bool_] | None = None,
        info: Mapping[str, Any] | None = None,
    ) -> None:
        """Begin episodes.

        Parameters
        ----------
        seed : int or sequence of int, optional
            As for the reset of a vector environment: one per environment, or the first one's, from which the others
            follow by
            ones. A random policy restarts an environment's stream with a seed and continues it without one.
        mask : (num_envs,) bool array, optional
            Which environments begin an episode; by default all.
        info : mapping, optional
            Info of the reset, or of the step that reset them: an array of length `Task.num_envs` per entry. Privileged
            policies read ``info["object"]``, the name of each object (or its index, with ``info="numeric"``).

        Raises
        ------
        ConfigError
            If a length is wrong, or an entry of `info` is missing.
        """
        count = self.task.num_envs
        if mask is not None and (np.shape(mask) != (count,) or np.asarray(mask).dtype != np.bool_):
            raise ConfigError(f"mask is {mask!r}; pass an array of {count} bool")
        seeds: list[int | None]
        if seed is None:
            seeds = [None] * count
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + i for i in range(count)]
        else:
            seeds = [None if one is None else int(one) for one in seed]
        if len(seeds) != count:
            raise ConfigError(f"there are {len(seeds)} seeds; pass one for each of the {count} environments")
        columns = {name: np.atleast_1d(np.asarray(value)) for name, value in _columns(info or {}).items()}
        for name, values in columns.items():
            if len(values) != count:
                raise ConfigError(
                    f"info[{name!r}] has {len(values)} rows; pass one for each of the {count} environments"
                )
        for env in range(count) if mask is None else np.flatnonzero(mask).tolist():
            self._begin(env, seeds[env], {name: values[env] for name, values in columns.items()})
        if self.base is not None:
            self.base.reset(seed, mask=mask, info=info)

    @abstractmethod
    def act(self, observation: Any) -> Actions:
        """Choose the next actions.

        Parameters
        ----------
        observation : (num_envs, ...) array, or mapping of them
            As the vector environment returns it. Rows of environments whose episode is over, and their actions, have no
            meaning.

        Returns
        -------
        (num_envs, k) float32 array
            A row of zeros where the policy does not act.
        """

    def _bind(self, task: Task) -> None:
        """Allocate the state of each environment."""
        del task

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        """Begin an episode in one environment; `info` holds its row of every entry."""
        del env, seed, info

    def confidence(self, env: int) -> float | None:
        """Return the stated probability that the last grasp of an environment succeeds; None without one."""
        del env
        return None

    def found_nothing(self, env: int) -> bool:
        """Whether its last look at an environment found no grasp, so that its action is zeros.

        False before the first look, and of policies that do not state it. Rounds of clearing end there without an
        attempt
        (`graspbox.evaluation.rounds`).
        """
        del env
        return False

    def _zeros(self) -> Actions:
        return np.zeros((self.task.num_envs, *self.task.action_space.shape), dtype=np.float32)


class SeededPolicy(Policy):
    """A policy with a random stream per environment, which the seed of an episode restarts."""

    def bind(self, task: Task) -> None:
        """Prepare for environments: see `Policy.bind`."""
        self._streams = [np.random.default_rng() for _ in range(task.num_envs)]
        super().bind(task)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del info
        if seed is not None:
            self._streams[env] = np.random.default_rng(seed)


def _columns(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of an info, without masks, nested entries and those of the last episode."""
    return {
        name: value
        for name, value in info.items()
        if not name.startswith(("_", "final_")) and not isinstance(value, Mapping)
    }
