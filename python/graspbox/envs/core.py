"""Core of all environments, single and vector: a pool, and the conversion of its rows to Gymnasium's values."""

import inspect
import os
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Literal, get_args, get_type_hints

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox._common.arguments import about, config_dict, natural, plain, shown
from graspbox._common.window import Window
from graspbox._core import Arm
from graspbox.configs import CamerasConfig, ClutterConfig, EnvConfig, GoalConfig, Randomization, TrialConfig
from graspbox.envs import spaces
from graspbox.envs._pools.local import LocalPool, LocalSource, PoolInterface, Source
from graspbox.envs._pools.source import RemoteSource
from graspbox.envs.remote_config import remote_config
from graspbox.envs.reward import DECISION_WEIGHTS, WEIGHTS, goal_weights, term_weights, total
from graspbox.envs.settings import (
    RENDER_MODES,
    ClearConfig,
    Control,
    DecisionConfig,
    DecisionControl,
    EnvironmentConfig,
    GoalTaskConfig,
    GraspConfig,
    GraspPoseConfig,
    ObjectsArgument,
    PlaceConfig,
    VectorConfig,
    complete,
)
from graspbox.errors import ConfigError
from graspbox.simulation.layouts import SCALES, Arrangement, Layout, layout_named, scene_layout_named


def checked_options(options: Any, name: str = "options", hint: str = "") -> dict[str, Any]:
    """Check that the options of a reset, called `name`, are a mapping or None; the ConfigError ends with `hint`."""
    if options is not None and not isinstance(options, Mapping):
        raise ConfigError(f"{name} is {shown(options)}; give a dictionary of reset options, or None{hint}")
    return dict(options or {})


def checked_autoreset(choice: AutoresetMode | str) -> AutoresetMode:
    """Return an autoreset mode from itself or its value."""
    try:
        return AutoresetMode(choice)
    except ValueError:
        known = ", ".join(mode.value for mode in AutoresetMode)
        raise ConfigError(f"there is no autoreset mode {choice!r}; choose from {known}") from None


def checked_seed(seed: Any) -> int:
    """Return a seed as an int; numpy integers are accepted, seeds out of the core's range are not."""
    return natural(seed, "seed", bits=64)


def fresh_seed() -> int:
    """Sample a seed from the operating system's entropy."""
    return secrets.randbits(63)


class GraspCore:
    """A pool of environments with its spaces, weights and names.

    It can be pickled and copied, and so can an environment that holds it: a pickle contains the settings and the state
    of every environment that has begun an episode. `kind` is one of the classes of `graspbox.envs.settings`, and
    `arguments` has keywords of that kind; missing ones take their defaults.
    """

    def __init__(
        self, kind: type[EnvironmentConfig], num_envs: int, objects: ObjectsArgument, arguments: Mapping[str, Any]
    ) -> None:
        num_envs = natural(num_envs, "num_envs")
        self._made_of = (kind, num_envs, objects, dict(arguments))
        settings = complete(kind, arguments)
        self.render_mode = settings.render_mode
        if self.render_mode not in (None, *RENDER_MODES):
            modes = ", ".join(map(repr, RENDER_MODES))
            with about("render_mode"):
                raise ConfigError(f"render_mode={self.render_mode!r} is not available; use None or one of {modes}")
        self._window = Window("graspbox") if self.render_mode == "human" else None
        if settings.info not in ("full", "numeric"):
            raise ConfigError(f"info is {settings.info!r}; choose from 'full', 'numeric'")
        self._numeric = settings.info == "numeric"
        self._goal = _goal(settings)
        with about("obs"):
            images = spaces.image_names(settings.obs)
        cameras = completed(settings.cameras, images, settings.image_size)
        # A single environment is a vector of one without autoreset.
        vector = settings if isinstance(settings, VectorConfig) else VectorConfig(autoreset_mode=AutoresetMode.DISABLED)
        # With autoreset, a step that begins the next episode must not wait for a mesh file.
        prepare_files = natural(vector.prepare_files, "prepare_files")
        with about("autoreset_mode"):
            self.autoreset_mode = checked_autoreset(vector.autoreset_mode)
        self._prepare_files = 0 if self.autoreset_mode is AutoresetMode.DISABLED else prepare_files
        self.source = self._source_of(num_envs, objects, settings)
        try:
            self._complete(num_envs, settings, cameras, vector.max_episode_steps)
        except BaseException:
            self.source.close()
            raise

    def _complete(
        self, num_envs: int, settings: EnvironmentConfig, cameras: CamerasConfig, max_steps: int | None
    ) -> None:
        """Make spaces, weights and the pool."""
        self.hand, self.arm, self.tables = self.source.hand, self.source.arm, self.source.tables
        # An environment whose steps are decisions has a trial instead of a control mode.
        self._decides = isinstance(settings, DecisionConfig)
        clutter, layout = _clutter(settings), settings.layout
        # A single object counts as packed: it stays where it was placed.
        self._layout: Layout = "packed" if layout == "single" else layout_named(layout)
        acting = settings if isinstance(settings, GraspConfig) else GraspConfig()
        vectors = self._act(settings, acting)
        names = self._observe(settings, vectors, self.source.images(cameras, clutter.most_objects))
        if self._goal is not None:
            self.weights = goal_weights(settings.reward, self.tables)
        else:
            weights = DECISION_WEIGHTS if self._decides else WEIGHTS
            self.weights = term_weights(settings.reward, settings.reward_weights, self.tables, weights)
        trial = settings.trial if isinstance(settings, DecisionConfig) else TrialConfig()
        success = settings.success or trial.success
        self.config = EnvConfig(
            control=self.control,
            autoreset=self.autoreset_mode.name.lower(),  # type: ignore[arg-type]
            fingers=acting.fingers,
            control_freq=acting.control_freq,
            max_episode_steps=max_steps,
            observations=tuple(name for name in names if name not in cameras.images),
            randomization=_randomization(settings.randomization),
            clutter=clutter,
            cameras=cameras,
            goal=self._goal,
            success=success,
            # The closed loop has no trial whose lift height would have to reach the criterion's.
            trial=replace(trial, success=success) if self._decides else trial,
        )
        self.picture = config_dict(settings.picture)
        rendered = self.render_mode is not None
        self._pool: PoolInterface | None = self.source.pool(self.config, num_envs, self.picture, rendered)
        self._process = os.getpid()
        self.begun = np.zeros(num_envs, dtype=np.bool_)
        with_goal = None if self._goal is None else self.tables["goal"]
        self._terms = [term["name"] for term in (with_goal or self.tables)["terms"]]
        self._entries = (
            with_goal["info"] if with_goal else spaces.entries(self.control, self.tables, layout != "single")
        )
        # Numeric infos contain no names; do not load those of the objects, which may be many.
        names_of = {} if self._numeric else {"failures": self.tables["failures"], "objects": self.source.names()}
        self._names = {kind: np.array(found, dtype=object) for kind, found in names_of.items()}

    def _act(self, settings: EnvironmentConfig, acting: GraspConfig) -> dict[str, list[spaces.ArrayColumn]]:
        """Make the space of actions, and return the columns of the vectors observed with it."""
        decision = settings.control if isinstance(settings, GraspPoseConfig) else "clear"
        self.control: Control | DecisionControl | Literal["clear"] = decision if self._decides else acting.control
        known: Iterable[str] = get_args(DecisionControl) if self._decides else self.tables["actions"]
        for name, choices in (("control", known), ("fingers", self.tables["actions"]["twist"])):
            # An environment without one of these keywords has no wrong value of it.
            chosen = getattr(settings, name, next(iter(choices)))
            if chosen not in choices:
                with about(name):
                    more = ", or name an arm" if chosen == "joint_velocity" and self.arm is None else ""
                    raise ConfigError(f"{name} is {chosen!r}; choose from {', '.join(choices)}{more}")
        self.action_columns, vectors = spaces.columns_of(self.control, acting.fingers, self.tables)
        self.action_space = spaces.action_space(self.action_columns)
        self.action_size = spaces.size(self.action_columns)
        return vectors

    def _observe(
        self,
        settings: EnvironmentConfig,
        vectors: Mapping[str, list[spaces.ArrayColumn]],
        images: Sequence[spaces.Image],
    ) -> tuple[str, ...]:
        """Make the spaces of observations, and return the core's names of them."""
        obs, limits = settings.obs, _depth_limits(settings)
        with about("obs"):
            #: That of the pool's arrays.
            self.pool_space = spaces.observation_space(obs, vectors, self.tables, images)
            if limits is not None:
                images = [spaces.coarse_depth(row, limits) if row["kind"] == "depth" else row for row in images]
            self.observation_space = spaces.observation_space(obs, vectors, self.tables, images)
        # A Dict space sorts its names.
        self.obs = obs if isinstance(obs, str) else tuple(sorted(obs))
        names = (self.obs,) if isinstance(self.obs, str) else self.obs
        self._depth_limits, depth = limits, {name for name in names if name.partition("_")[0] == "depth"}
        if self._goal is None:
            self._depth = depth
            return names
        self._depth = {"observation"} if depth else set()
        self.pool_space = spaces.goal_space(self.pool_space, self.tables)
        self.observation_space = spaces.goal_space(self.observation_space, self.tables)
        self.obs = tuple(self.observation_space)
        return *names, *self.tables["goal"]["observations"]

    @staticmethod
    def _source_of(num_envs: int, objects: ObjectsArgument, settings: EnvironmentConfig) -> Source:
        """Make the source of the environments: this process, or servers."""
        remote = remote_config(settings.remote)
        if remote is not None:
            return RemoteSource(remote, num_envs, objects, settings)
        found = object_sets.load(objects, scale=settings.scale, mass=settings.mass, split=settings.split)
        return LocalSource(found, settings)

    def __getstate__(self) -> dict[str, Any]:
        states = [self.pool.get_state(env) if begun else None for env, begun in enumerate(self.begun)]
        return {"made_of": self._made_of, "states": states}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(*saved["made_of"])  # type: ignore[misc]
        for env, state in enumerate(saved["states"]):
            if state is not None:
                self.restore(env, state)

    @property
    def pool(self) -> PoolInterface:
        """The pool; an error after it is closed, and in any process but the one that made it."""
        if self._pool is None:
            raise gymnasium.error.ClosedEnvironmentError("this environment is closed; make another one")
        if os.getpid() != self._process:
            raise ConfigError(
                f"this environment was made in process {self._process}, whose threads a forked process ({os.getpid()}) "
                "does not have; make it in the process that steps it, or send it there by pickle"
            )
        return self._pool

    @property
    def local_pool(self) -> "_core.EnvPool":
        """The core's pool, of environments in this process."""
        pool = self.pool
        if not isinstance(pool, LocalPool):
            raise ConfigError("these environments are on a server; make them without the keyword remote")
        return pool.core

    @property
    def world_from_arm(self) -> NDArray[np.float64] | None:
        """Pose of the arm's base, (4, 4), in this process."""
        if not isinstance(self.source, LocalSource):
            raise ConfigError("these environments are on a server, which does not tell the place of the arm; give base")
        return self.source.handle.world_from_arm

    @property
    def fps(self) -> int:
        """Frames per second of a video with one frame per step; with one decision per episode, 1."""
        return 1 if self._decides else max(1, round(self.config.control_freq))

    @property
    def idle_action(self) -> NDArray[np.float32]:
        """The action without motion, with the preshape at its lower limit, for modes whose actions are motions."""
        action = np.zeros(self.action_size, dtype=np.float32)
        action[self.action_places("preshape")] = -1.0
        return action

    def action_places(self, name: str) -> NDArray[np.bool_]:
        """Mask (n,) of the entries of an action whose column has this name."""
        return np.repeat(
            [row["name"] == name for row in self.action_columns], [row["size"] for row in self.action_columns]
        )

    def close(self) -> None:
        """Free the environments and close the window; repeated calls do nothing."""
        if self._pool is not None and os.getpid() == self._process:
            self._pool.close()
        self._pool = None
        if self._window is not None:
            self._window.close()

    def prepare(self, progress: bool, delay: float = 0.0, skip_errors: bool = False) -> None:
        """Prepare all objects; with `progress`, a bar appears on standard error after `delay` seconds."""
        self.pool.prepare(progress, delay, skip_errors)

    def _prepare_first(self) -> None:
        """Prepare all objects before the first episodes if some are mesh files and there are few enough of them."""
        few = self.source.has_files and self.source.count <= self._prepare_files
        if few and not self.begun.any():
            self.prepare(progress=True, delay=2.0, skip_errors=True)

    def reset(
        self,
        seeds: Sequence[int | None] | None,
        mask: NDArray[np.bool_] | None,
        options: Sequence[Mapping[str, Any] | None],
        out: dict[str, Any] | None = None,
    ) -> "_core.EnvArrays":
        """Begin episodes in the environments of the mask; `options` has one entry for all of them, or one for each."""
        chosen = [plain(checked_options(one), "reset options") for one in options]
        self._prepare_first()
        arrays = self.pool.reset(seeds, mask, chosen, out)
        self.begun |= True if mask is None else mask
        self.show()
        return arrays

    def step(
        self, actions: Any, out: dict[str, Any] | None = None
    ) -> tuple["_core.EnvArrays", "_core.EnvArrays | None"]:
        """Step all environments: their rows, and the final rows of episodes whose successors began in this step."""
        pool = self.pool
        self._check_begun("step")
        found = pool.step(self.action(actions, len(self.begun)), out)
        self.show()
        return found

    def _check_begun(self, method: str) -> None:
        if not self.begun.all():
            raise gymnasium.error.ResetNeeded(f"call reset before {method}")

    def restore(self, env: int, state: bytes) -> "_core.EnvArrays":
        """Restore a state of one environment."""
        if not isinstance(state, bytes):
            raise ConfigError(f"state is {shown(state)}; give the bytes that get_state returned")
        arrays = self.pool.set_state(env, state)
        self.begun[env] = True
        return arrays

    def observations(self, arrays: "_core.EnvArrays") -> Any:
        """Return the observations of all rows: an array, or a dictionary of arrays."""
        if isinstance(self.obs, str):
            return self._observed(self.obs, arrays)
        return {name: self._observed(name, arrays) for name in self.obs}

    def _observed(self, name: str, arrays: "_core.EnvArrays") -> NDArray[Any]:
        found: NDArray[Any] = arrays[name]  # type: ignore[literal-required]
        if self._depth_limits is None or name not in self._depth:
            return found
        return spaces.depth_as_uint8(found, self._depth_limits)

    def first(self, arrays: "_core.EnvArrays") -> tuple[Any, dict[str, Any]]:
        """Return observation and info of the first row."""
        found = self.observations(arrays)
        observation = {name: rows[0] for name, rows in found.items()} if isinstance(found, dict) else found[0]
        return observation, row(self.columns(arrays), 0)

    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8] | None:
        """Render pictures of some environments, (n, H, W, 3), with ``render_mode="rgb_array"``; otherwise None."""
        pool = self.pool
        if self.render_mode is None:
            return None
        self._check_begun("render")
        if self._window is not None:
            self.show()
            return None
        return pool.pictures(envs)

    def arrangement(self, env: int) -> Arrangement:
        """Return the objects of one local environment as they lie, and its walls; **privileged**."""
        found = self.local_pool.scene(env)
        return Arrangement(
            layout=self._layout,
            target=found["target"],
            objects=tuple(int(index) for index in found["objects"]),
            meshes=tuple(found["meshes"]),
            world_from_objects=found["world_from_objects"],
            world_from_walls=found["world_from_walls"],
            wall_half_extents=found["wall_half_extents"],
        )

    def show(self) -> None:
        """Show the first environment in the window, with ``render_mode="human"``."""
        if self._window is not None:
            self._window.show(self.pool.pictures([0])[0], self.fps)

    def rewards(self, arrays: "_core.EnvArrays") -> NDArray[np.float64]:
        """Return the reward of every row: the weighted sum of its terms."""
        return total(self.weights, arrays["terms"])

    def goal_rewards(self, achieved_goal: Any, desired_goal: Any) -> Any:
        """Return the rewards of one goal or many, (..., 3) each, in an environment with goals, whatever its state."""
        assert self._goal is not None
        achieved, desired = (np.asarray(goal, dtype=np.float32) for goal in (achieved_goal, desired_goal))
        if achieved.shape[-1:] != (3,) or achieved.shape != desired.shape:
            raise ConfigError(f"the goals have shapes {achieved.shape} and {desired.shape}; give (3,), or (n, 3)")
        pairs = np.ascontiguousarray(achieved.reshape(-1, 3)), np.ascontiguousarray(desired.reshape(-1, 3))
        terms = _core.goal_rewards(*pairs, self._goal.threshold)
        return total(self.weights[: len(self._terms)], terms).reshape(achieved.shape[:-1])[()]

    def columns(self, arrays: "_core.EnvArrays") -> dict[str, Any]:
        """Return the infos of all rows: an array per entry of the core's table, and one per reward term."""
        terms = np.ascontiguousarray(arrays["terms"].T[: len(self._terms)], dtype=np.float64)
        if arrays["reset"].any():
            # In rows that begin an episode, the terms belong to the end of the one before.
            terms[:, arrays["reset"]] = 0.0
        if self._numeric:
            numbers: dict[str, Any] = {entry["name"]: arrays["info"][entry["name"]] for entry in self._entries}
            return {**numbers, **{f"reward_{name}": values for name, values in zip(self._terms, terms, strict=True)}}
        info = {entry["name"]: self._entry(entry, arrays["info"][entry["name"]]) for entry in self._entries}
        return {**info, "reward_terms": dict(zip(self._terms, terms, strict=True))}

    def _entry(self, entry: spaces.Entry, values: NDArray[Any]) -> NDArray[Any]:
        """Replace indices by names."""
        names: NDArray[Any] | None = self._names.get(entry["names"] or "")
        return values if names is None else names[values]

    def action(self, action: Any, rows: int) -> NDArray[np.float32]:
        """Convert actions for the core, which checks that they are finite in environments that step."""
        size = self.action_size
        actions = np.asarray(action, dtype=np.float32)
        if actions.shape != (rows, size) and (rows, *actions.shape) != (1, size):
            raise ConfigError(
                f"the action has shape {actions.shape}; give {size} numbers for each of {rows} environments"
            )
        return np.ascontiguousarray(actions.reshape(rows, size))


class CoreEnvironment:
    """Base of environments on a `GraspCore`, whose constructor takes the fields of a config as keywords.

    ``class Env(..., config=kind)`` names the config.
    """

    config_class: type[EnvironmentConfig]
    _core: GraspCore

    def __init_subclass__(cls, *, config: type[EnvironmentConfig] | None = None) -> None:
        super().__init_subclass__()
        if config is None:
            return
        cls.config_class = config
        # For `inspect.signature` and ``help``: every keyword with its default.
        own, types, keyword = inspect.signature(cls.__init__), get_type_hints(config), inspect.Parameter.KEYWORD_ONLY
        named = [p for p in own.parameters.values() if p.name != "self" and p.kind is not p.VAR_KEYWORD]
        rest = [inspect.Parameter(f.name, keyword, default=f.default, annotation=types[f.name]) for f in fields(config)]
        cls.__signature__ = own.replace(parameters=[*named, *rest])  # type: ignore[attr-defined]

    @property
    def objects(self) -> object_sets.ObjectSet:
        """The objects that episodes sample from; those of servers are loaded in this process on first use."""
        return self._core.source.objects()

    @property
    def arm(self) -> Arm | None:
        """The arm that carries the hand; None for a hand that moves freely."""
        return self._core.arm

    @property
    def world_from_arm(self) -> NDArray[np.float64] | None:
        """Pose of the arm's base, (4, 4); None without an arm. Of environments in this process."""
        return self._core.world_from_arm

    def prepare(self, progress: bool = False) -> None:
        """Prepare all objects now: convex parts, resting poses and, if images are rendered, levels of detail.

        Otherwise the first reset of a vector environment prepares sets with mesh files (see its keyword
        ``prepare_files``), and during each episode a background thread prepares the objects of the next three; a step
        or reset that needs one sooner waits. Results are the same. Environments of this process with the same objects,
        hand and physics share prepared objects (512 stay in memory). Convex parts and levels of detail are also cached
        on disk for other processes.

        Parameters
        ----------
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        MeshError, FileError, SimulationError
            If an object cannot be read or simulated; others may be ready by then.
        """
        self._core.prepare(progress)


def _goal(settings: EnvironmentConfig) -> GoalConfig | None:
    """Make the config of goals; refuse keywords that have no meaning with them."""
    if not isinstance(settings, GoalTaskConfig):
        return None
    reasons = {
        "reward_weights": "the reward is a function of the goals alone",
        "success": "success is a distance, the threshold",
        "layout": "one object lies on the table",
    }
    for name, reason in reasons.items():
        if (value := getattr(settings, name)) != getattr(EnvironmentConfig, name):
            with about(name):
                raise ConfigError(f"{name} is {shown(value)}, but in a goal task {reason}; leave it out")
    if not isinstance(settings.obs, str):
        with about("obs"):
            raise ConfigError(f"obs is {shown(settings.obs)}; name one observation, the entry 'observation'")
    task: Literal["reach", "place"] = "place" if isinstance(settings, PlaceConfig) else "reach"
    return GoalConfig(task, settings.threshold, settings.terminate_on_success)


def _depth_limits(settings: EnvironmentConfig) -> tuple[float, float] | None:
    """Return the limits of depth as uint8."""
    if settings.depth_limits is None:
        return None
    near, far = map(float, settings.depth_limits)
    if not 0.0 <= near < far < float("inf"):
        with about("depth_limits"):
            raise ConfigError(
                f"depth_limits is {shown(settings.depth_limits)}; give the near and the far limit, metres: (0.1, 1.0)"
            )
    return near, far


def _clutter(settings: EnvironmentConfig) -> ClutterConfig:
    """Make the config of scenes from their keywords."""
    with about("layout"):
        layout = scene_layout_named(settings.layout)
    most = settings.max_failures if isinstance(settings, ClearConfig) else ClutterConfig.max_failures
    failures = natural(most, "max_failures")
    if layout == "single":
        for name in ("objects_per_scene", "object_scale", "spread"):
            if (value := getattr(settings, name)) != getattr(EnvironmentConfig, name):
                with about(name):
                    raise ConfigError(f"{name} is {value!r}, but layout='single' has one object; choose another")
        return ClutterConfig(max_failures=failures)
    count = settings.objects_per_scene
    low, high = (count, count) if isinstance(count, int | np.integer) else count
    with about("objects_per_scene"):
        low, high = natural(low, "objects_per_scene"), natural(high, "objects_per_scene")
    scale = SCALES[layout] if settings.object_scale is None else settings.object_scale
    return ClutterConfig(
        layout={"bin": {"inside": tuple(map(float, settings.bin_size))}} if layout == "bin" else layout,
        objects_per_scene=(low, high),
        scale=(float(scale[0]), float(scale[1])),
        spread=settings.spread,
        max_failures=failures,
    )


def _randomization(randomization: Literal["standard"] | Randomization | None) -> Randomization:
    if randomization is None:
        return Randomization()
    if randomization == "standard":
        return Randomization.standard()
    if isinstance(randomization, Randomization):
        return randomization
    with about("randomization"):
        raise ConfigError(f"randomization is {randomization!r}; give None, 'standard' or a Randomization")


def completed(
    cameras: CamerasConfig, images: tuple[str, ...], image_size: int | tuple[int, int] | None
) -> CamerasConfig:
    """Add the images of `obs` and the image size to the cameras."""
    if cameras.images:
        raise ConfigError(f"cameras.images is {cameras.images!r}; name images in obs")
    size = cameras.image_size if image_size is None else image_size
    height, width = (size, size) if isinstance(size, int | np.integer) else size
    if not all(16 <= side <= 1024 for side in (height, width)):
        raise ConfigError(f"image_size is {size!r}; sides must be between 16 and 1024 pixels")
    return replace(cameras, images=images, image_size=(int(height), int(width)))


def row(columns: dict[str, Any], index: int) -> dict[str, Any]:
    """Return one row of the columns, as plain Python values."""
    return {
        name: row(values, index) if isinstance(values, dict) else values[index : index + 1].tolist()[0]
        for name, values in columns.items()
    }
