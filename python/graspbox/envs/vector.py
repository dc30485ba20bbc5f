"""Many environments of ``graspbox/Grasp-v0`` in one call: ``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64)``.

Each environment equals the single one of `graspbox.envs.grasp` bit for bit, infos included, regardless of the others.
One call into Rust steps all worlds on all threads, while other Python threads run.

The three autoreset modes are Gymnasium's: ``NEXT_STEP`` (the step after the end of an episode begins the next one and
ignores its action), ``SAME_STEP`` (the next episode begins in the same step; ``final_obs`` and ``final_info`` describe
the end of the last one), ``DISABLED`` (``reset(options={"reset_mask": done})`` begins the next episodes).

With ``SAME_STEP``, use the wrapper `RecordEpisodeStatistics` of Gymnasium 1.4 or later: earlier versions count one step
too few per episode.

A reset takes the single environment's options for all environments, and ``each`` for options that differ:
``reset(options={"friction": 0.8, "each": [{"object": "mug-000000"}, None, {"resting": 1}]})``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space, create_empty_array
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import natural
from graspbox.envs._vector_parts import (
    full,
    mask_of,
    options_of_each,
    reset_mask,
    scattered,
    seeds_of,
    taken,
)
from graspbox.envs.core import CoreEnvironment, GraspCore, checked_options
from graspbox.envs.settings import (
    RENDER_MODES,
    GraspVectorConfig,
    ObjectsArgument,
)
from graspbox.errors import ConfigError
from graspbox.simulation.layouts import Arrangement

__all__ = ["EnvView", "GraspVectorEnv", "NativeVectorEnv"]

Step = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


#: Attributes shared by all environments, and their names in the vector environment.
_SHARED = {
    "objects": "objects",
    "render_mode": "render_mode",
    "spec": "spec",
    "observation_space": "single_observation_space",
    "action_space": "single_action_space",
}


class EnvView:
    """The environment that `NativeVectorEnv.call`, ``get_attr`` and ``set_attr`` access; new attributes can be set."""

    def __init__(self, vector: "NativeVectorEnv", index: int) -> None:
        self._vector, self._index = vector, index

    def __getattr__(self, name: str) -> Any:
        # Called for missing attributes only; a copy under construction has no vector environment yet.
        if name in _SHARED and "_vector" in self.__dict__:
            return getattr(self._vector, _SHARED[name])
        raise AttributeError(f"an environment has no attribute {name!r} here")

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _SHARED:
            raise AttributeError(f"{name!r} is shared by all environments")
        super().__setattr__(name, value)

    @property
    def np_random_seed(self) -> int | None:
        """The initial seed of its random stream; None before its first reset, -1 if unknown."""
        return self._vector.np_random_seed[self._index]

    def get_state(self) -> bytes:
        """Return the complete state of the environment."""
        return self._vector.get_state(self._index)

    def set_state(self, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Restore a state; returns observation and info."""
        return self._vector.set_state(self._index, state)

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (4, 4) of every camera at present, by name."""
        found = self._vector.cameras().items()
        return {name: (intrinsics, poses[self._index]) for name, (intrinsics, poses) in found}

    def render(self) -> NDArray[np.uint8] | None:
        """Render a picture, (H, W, 3); None without a render mode."""
        return self._vector.picture(self._index)


class NativeVectorEnv(CoreEnvironment, VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """A pool of environments with Gymnasium's interface of vector environments.

    Like the single one, it can be pickled and copied (by `pickle`, `cloudpickle`, `copy.deepcopy`), except while steps
    are pending between `send` and `recv`.

    Parameters
    ----------
    num_envs : int
        Number of environments.
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    **keywords
        Fields of the config of the environment in `graspbox.envs.settings`.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        For a wrong argument; objects are read when they are first sampled.
    """

    _view_class = EnvView

    def __init__(self, num_envs: int = 1, objects: ObjectsArgument = "procedural", **keywords: Any) -> None:
        super().__init__()
        self._core = core = GraspCore(self.config_class, num_envs, objects, keywords)
        self.autoreset_mode = core.autoreset_mode
        self.num_envs = core.pool.num_envs
        self.render_mode = core.render_mode
        self.metadata = {
            "render_modes": [*RENDER_MODES],
            "render_fps": core.fps,
            "autoreset_mode": core.autoreset_mode,
        }
        self.single_observation_space = core.observation_space
        self.single_action_space = core.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.copy: bool = keywords.get("copy", True)
        self._seeds: list[int | None] = [None] * self.num_envs
        self._views: tuple[EnvView, ...] = ()
        self._out = None if self.copy else self._buffers()

    def _buffers(self) -> dict[str, Any]:
        buffers: Any = create_empty_array(self._core.pool_space, self.num_envs)
        return {self._core.obs: buffers} if isinstance(self._core.obs, str) else buffers

    @property
    def object_names(self) -> list[str]:
        """Names of the objects that episodes sample from, in order; those of a server need not be on this machine."""
        return self._core.source.names()

    @property
    def is_remote(self) -> bool:
        """Whether servers step the environments."""
        return self._core.source.is_remote

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The initial seed of each environment's random stream; None before its first reset, -1 if unknown."""
        return tuple(self._seeds)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Seed of the first environment, from which those of the others count up; or one per environment, where None
            continues its stream.
        options : dict, optional
            Options of the single environment, for all environments. ``each`` is a sequence of ``num_envs`` such
            dictionaries or None, whose entries override them in one environment. ``reset_mask``, (num_envs,) bool,
            selects the environments that begin an episode; the others do not change, and infos do not cover them.

        Raises
        ------
        ConfigError, MeshError, FileError, SimulationError
            As the single environment; other environments may have begun their episodes already.
        """
        shared = checked_options(
            options, hint="; options that differ go into options['each'], one for each environment"
        )
        mask = reset_mask(shared.pop("reset_mask", None), self.num_envs)
        each = options_of_each(shared.pop("each", None), shared, self.num_envs)
        seeds = seeds_of(seed, mask, self._seeds)
        arrays = self._core.reset(seeds, mask, each, self._out)
        self._seeds = [old if new is None else new for old, new in zip(self._seeds, seeds, strict=True)]
        columns = self._core.columns(arrays)
        observations = self._core.observations(arrays)
        if mask is None:
            return observations, full(columns, self.num_envs)
        begun = np.flatnonzero(mask)
        return observations, scattered(taken(columns, begun), begun, self.num_envs)

    def step(self, actions: NDArray[np.float32]) -> Step:
        """Step every environment.

        Parameters
        ----------
        actions : (num_envs, n) array
            One action per environment; ignored for an environment that begins an episode in this step.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            Arrays of length ``num_envs``.

        Raises
        ------
        ConfigError
            As the single environment; no environment has been stepped then.
        """
        now, last = self._core.step(actions, self._out)
        return self._results(now, last, self.num_envs)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Render a picture of every environment, (H, W, 3) each, with ``render_mode="rgb_array"``.

        With ``render_mode="human"``, update the window with the first environment, as every reset and step does.
        """
        pictures = self._core.pictures(range(self.num_envs))
        return None if pictures is None else tuple(pictures)

    def picture(self, env: int) -> NDArray[np.uint8] | None:
        """Render a picture of one environment, as `render` does for all."""
        pictures = self._core.pictures([env])
        return None if pictures is None else pictures[0]

    def close_extras(self, **kwargs: Any) -> None:
        """Free the environments; afterwards only another close is allowed."""
        # A constructor that failed leaves no core.
        if hasattr(self, "_core"):
            self._core.close()

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of every environment: ``get_state``, ``set_state``, ``cameras`` or ``render``.

        The arguments are the same for all. An attribute is read, as by `get_attr`.
        """
        found = [getattr(env, name) for env in self.envs]
        return tuple(one(*args, **kwargs) if callable(one) else one for one in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Read an attribute of every environment: one of the single environment, or one added by `set_attr`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment, to be read by `get_attr`.

        Parameters
        ----------
        name : str
            Any name except those of shared attributes, such as ``objects`` or ``render_mode``.
        values : list, tuple or object
            One value per environment, or one for all.

        Raises
        ------
        ConfigError
            For a wrong number of values, or a shared attribute.
        """
        if not isinstance(values, list | tuple):
            values = [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ConfigError(f"there are {len(values)} values; give one for each of the {self.num_envs} environments")
        for env, value in zip(self.envs, values, strict=True):
            try:
                setattr(env, name, value)
            except AttributeError:
                raise ConfigError(f"{name!r} is shared by all environments; give it to the constructor") from None

    @property
    def envs(self) -> tuple[EnvView, ...]:
        """A view of each environment, with attributes and methods of the single one."""
        if not self._views:
            self._views = tuple(self._view_class(self, env) for env in range(self.num_envs))
        return self._views

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (num_envs, 4, 4) of every camera at present, by name."""
        return self._core.pool.cameras()

    def send(self, actions: NDArray[np.float32], envs: Sequence[int] | NDArray[np.integer[Any]] | None = None) -> None:
        """Step environments in the background.

        Parameters
        ----------
        actions : (k, n) array
            One action for each of them.
        envs : (k,) sequence of int, optional
            Indices of the environments to step; by default all.

        Raises
        ------
        ConfigError
            As `step`, or if a step of one of them is still pending.
        """
        indices = range(self.num_envs) if envs is None else [int(env) for env in envs]
        if any(not 0 <= env < self.num_envs for env in indices):
            raise ConfigError(f"envs is {list(indices)}; indices are between 0 and {self.num_envs - 1}")
        self._core.pool.send(self._core.action(actions, len(indices)), list(indices))

    def recv(self, count: int | None = None) -> Step:
        """Receive results of steps begun by `send`, in the order in which they finish.

        Parameters
        ----------
        count : int, optional
            Number of results to wait for; by default ``num_envs``.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            As `step`, with one row per result; ``infos["env_id"]`` has the indices of their environments.

        Raises
        ------
        ConfigError
            If fewer steps are pending.
        """
        count = self.num_envs if count is None else natural(count, "count")
        now, last = self._core.pool.recv(count)
        results = self._results(now, last, count)
        results[-1].update(full({"env_id": now["env"]}, count))
        return results

    def arrangement(self, env: int) -> Arrangement:
        """Return the objects of an environment as they lie, and walls; **privileged**, only in this process."""
        return self._core.arrangement(env)

    def get_state(self, env: int) -> bytes:
        """Return the complete state of an environment, its random stream included."""
        return self._core.pool.get_state(natural(env, "env"))

    def set_state(self, env: int, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Restore a state returned by `get_state` of this environment or of a single one.

        Returns
        -------
        observation, info
            Those of the environment at that time.

        Raises
        ------
        ConfigError, SimulationError
            As `graspbox.envs.single.SingleEnv.set_state`.
        """
        arrays = self._core.restore(natural(env, "env"), state)
        if self._seeds[env] is None:
            # The random stream comes from the state; its seed is unknown.
            self._seeds[env] = -1
        return self._core.first(arrays)

    def _results(self, now: "_core.EnvArrays", last: "_core.EnvArrays | None", count: int) -> Step:
        """Assemble the results of a step of `count` environments."""
        infos = full(self._core.columns(now), count)
        if last is not None:
            # `last` has a row for each environment whose episode ended in this step, `now` for each that stepped.
            ended = np.flatnonzero(np.isin(now["env"], last["env"]))
            order = np.argsort(last["env"])[np.argsort(np.argsort(now["env"][ended]))]
            infos |= self._final(last, ended, order, count)
        observations, rewards = self._core.observations(now), self._core.rewards(now)
        return observations, rewards, now["terminated"], now["truncated"], infos

    def _final(
        self, last: "_core.EnvArrays", ended: NDArray[np.intp], order: NDArray[np.intp], count: int
    ) -> dict[str, Any]:
        """Assemble the final observations and infos; rows `order` of `last` belong to rows `ended` of the step."""
        observations = self._core.observations(last)
        final_obs = np.full(count, None, dtype=object)
        for target, source in zip(ended, order, strict=True):
            final_obs[target] = (
                {name: rows[source] for name, rows in observations.items()}
                if isinstance(observations, dict)
                else observations[source]
            )
        info = scattered(taken(self._core.columns(last), order), ended, count)
        return {
            "final_obs": final_obs,
            "_final_obs": mask_of(ended, count),
            "final_info": info,
            "_final_info": mask_of(ended, count),
        }


class GraspVectorEnv(NativeVectorEnv, config=GraspVectorConfig):
    """Vector environment of ``Grasp-v0``: see the module, and `NativeVectorEnv` for its methods."""
