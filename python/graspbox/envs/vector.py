"""Many environments of ``graspbox/Grasp-v0`` in one call: ``gymnasium.make_vec("graspbox/Grasp-v0", num_envs=64)``.

Every environment is the single one of `graspbox.envs.grasp`, bit for bit, infos included, whatever runs beside it. All
worlds are stepped by one call into Rust, on as many threads as there are, while other Python threads run.

Three modes of autoreset, as Gymnasium defines them: ``NEXT_STEP`` (the step after the last one begins the next episode
and ignores its action), ``SAME_STEP`` (the next episode begins at once; ``final_obs`` and ``final_info`` tell of the
last one), ``DISABLED`` (``reset(options={"reset_mask": done})`` begins the next episodes).
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, create_empty_array
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox.configs import CamerasConfig, PhysicsConfig, PictureConfig, Randomization
from graspbox.envs.core import (
    FPS,
    Control,
    GraspCore,
    HandArgument,
    ObjectsArgument,
    RenderMode,
    Reward,
    checked_seed,
    fresh_seed,
    options_json,
)
from graspbox.errors import ConfigError

__all__ = ["GraspVectorEnv"]

AUTORESET: dict[AutoresetMode, Literal["next_step", "same_step", "disabled"]] = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}

Step = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class GraspVectorEnv(VectorEnv[Any, NDArray[np.float32], NDArray[Any]]):
    """Environments side by side; parameters that are not named here are those of `graspbox.envs.grasp.GraspEnv`.

    Parameters
    ----------
    num_envs : int
        How many.
    autoreset_mode : AutoresetMode or its value
        When a finished environment begins again.
    max_episode_steps : int, optional
        Episodes are truncated after so many steps.
    copy : bool
        Whether observations are fresh arrays; otherwise they are views into buffers that the next call overwrites.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        If an argument is out of place.
    """

    def __init__(
        self,
        num_envs: int = 1,
        objects: ObjectsArgument = "procedural",
        *,
        split: object_sets.Split | None = None,
        obs: str | Sequence[str] = "state",
        reward: Reward = "sparse",
        reward_weights: Mapping[str, float] | None = None,
        image_size: int | tuple[int, int] | None = None,
        control: Control = "twist",
        frame_skip: int = 1,
        randomization: Literal["standard"] | Randomization | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: RenderMode = None,
        copy: bool = True,
        num_threads: int | None = None,
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        hand: HandArgument = "reflex",
        cameras: CamerasConfig = CamerasConfig(),  # noqa: B008 (frozen)
        picture: PictureConfig = PictureConfig(),  # noqa: B008 (frozen)
    ) -> None:
        mode = autoreset(autoreset_mode)
        core = GraspCore(
            num_envs,
            objects,
            split=split,
            obs=obs,
            reward=reward,
            reward_weights=reward_weights,
            image_size=image_size,
            cameras=cameras,
            picture=picture,
            control=control,
            frame_skip=frame_skip,
            randomization=randomization,
            render_mode=render_mode,
            num_threads=num_threads,
            physics=physics,
            hand=hand,
            autoreset=AUTORESET[mode],
            max_episode_steps=max_episode_steps,
        )
        self._take(core, num_envs, mode, render_mode, copy, FPS / frame_skip)

    def _take(
        self,
        core: GraspCore,
        num_envs: int,
        mode: AutoresetMode,
        render_mode: RenderMode,
        copy: bool,
        fps: float,
    ) -> None:
        """Become the environment of a pool."""
        super().__init__()
        self._core = core
        self.autoreset_mode = mode
        self.num_envs = num_envs
        self.objects = core.object_set
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": fps, "autoreset_mode": mode}
        self.single_observation_space = core.observation_space
        self.single_action_space = core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.copy = copy
        self._seeds: list[int | None] = [None] * num_envs
        self._out = None if copy else self._buffers()

    def _buffers(self) -> dict[str, Any]:
        buffers: Any = create_empty_array(self.single_observation_space, self.num_envs)
        return {self._core.obs: buffers} if isinstance(self._core.obs, str) else buffers

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seed that each environment's random stream began with; None before its first reset."""
        return tuple(self._seeds)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Seed of the first environment, the others' follow by ones; or one for each. Streams without one go on.
        options : dict, optional
            Those of the single environment, for all; and ``reset_mask``, (num_envs,) bool: which environments begin an
            episode. The others stay as they are; infos tell of the ones that begin.

        Raises
        ------
        ConfigError, MeshError, FileError, SimulationError
            As the single environment; other environments that were to begin may have begun.
        """
        given = dict(options or {})
        mask = _reset_mask(given.pop("reset_mask", None), self.num_envs)
        seeds = self._seeds_for(seed, mask)
        arrays = self._core.pool.reset(seeds, mask, options_json(given), self._out)
        self._seeds = [old if new is None else new for old, new in zip(self._seeds, seeds, strict=True)]
        columns = self._core.columns(arrays)
        observations = self._core.observations(arrays)
        if mask is None:
            return observations, _full(columns, self.num_envs)
        begun = np.flatnonzero(mask)
        return observations, _scattered(_rows(columns, begun), begun, self.num_envs)

    def step(self, actions: NDArray[np.float32]) -> Step:
        """Act in every environment for one step, as the single environment does.

        Parameters
        ----------
        actions : (num_envs, n) array
            As the single environment's; the row of an environment that begins an episode instead is ignored.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            Arrays of length ``num_envs``.

        Raises
        ------
        ConfigError
            As the single environment; then nothing has moved.
        """
        if None in self._seeds:
            raise gymnasium.error.ResetNeeded("call reset before step")
        now, last = self._core.pool.step(self._core.action(actions, self.num_envs), self._out)
        return self._results(now, last, self.num_envs)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Take a picture of every environment, (H, W, 3) each, with ``render_mode="rgb_array"``; nothing without."""
        if self.render_mode is None:
            return None
        if None in self._seeds:
            raise gymnasium.error.ResetNeeded("call reset before render")
        return tuple(self._core.pictures())

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (num_envs, 4, 4) of every camera as it stands, by name."""
        return self._core.cameras()

    def send(self, actions: NDArray[np.float32], envs: Sequence[int] | NDArray[np.integer[Any]] | None = None) -> None:
        """Let environments step while the caller does something else.

        Parameters
        ----------
        actions : (k, n) array
            One row for each of them.
        envs : (k,) sequence of int, optional
            Which; by default all.

        Raises
        ------
        ConfigError
            As `step`, or if one of them has not been received since it was sent.
        """
        indices = range(self.num_envs) if envs is None else [int(env) for env in envs]
        if any(not 0 <= env < self.num_envs for env in indices):
            raise ConfigError(f"envs is {list(indices)}; indices are between 0 and {self.num_envs - 1}")
        self._core.pool.send(self._core.action(actions, len(indices)), list(indices))

    def recv(self, count: int | None = None) -> Step:
        """Receive environments that were sent, in the order in which they finish.

        Parameters
        ----------
        count : int, optional
            How many to wait for; by default ``num_envs``.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            As `step`, with one row for each that arrived: ``infos["env_id"]`` tells which.

        Raises
        ------
        ConfigError
            If fewer are on their way.
        """
        count = self.num_envs if count is None else count
        now, last = self._core.pool.recv(count)
        results = self._results(now, last, count)
        results[-1].update(_full({"env_id": now["env"]}, count))
        return results

    def get_state(self, env: int) -> bytes:
        """Everything that the future of an environment depends on, its random stream included."""
        return self._core.pool.get_state(env)

    def set_state(self, env: int, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Take up a state that `get_state` gave, of this or of a single environment.

        Returns
        -------
        observation, info
            Of this environment, as they were then.

        Raises
        ------
        ConfigError, SimulationError
            As `graspbox.envs.grasp.GraspEnv.set_state`.
        """
        arrays = self._core.pool.set_state(env, state)
        if self._seeds[env] is None:
            # The stream is that of the state, whose seed is not known.
            self._seeds[env] = -1
        return self._core.first(arrays)

    def _seeds_for(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_] | None) -> list[int | None]:
        """Find the seeds of a reset; a stream that has not begun gets a fresh one."""
        given: list[int | None]
        if seed is None:
            given = [None] * self.num_envs
        elif isinstance(seed, int | np.integer):
            given = [int(seed) + i for i in range(self.num_envs)]
        else:
            given = list(seed)
        if len(given) != self.num_envs:
            raise ConfigError(f"there are {len(given)} seeds; give one for each of the {self.num_envs} environments")
        for env, (old, new) in enumerate(zip(self._seeds, given, strict=True)):
            if mask is not None and not mask[env]:
                given[env] = None
            elif new is None:
                given[env] = fresh_seed() if old is None else None
            else:
                given[env] = checked_seed(new)
        return given

    def _results(self, now: "_core.EnvArrays", last: "_core.EnvArrays | None", count: int) -> Step:
        """Put together what a step of `count` environments returns."""
        infos = _full(self._core.columns(now), count)
        if last is not None:
            # `last` has a row for each environment whose episode ended in this step; `now` has them all.
            ended = np.flatnonzero(np.isin(now["env"], last["env"]))
            order = np.argsort(last["env"])[np.argsort(np.argsort(now["env"][ended]))]
            infos |= self._final(last, ended, order, count)
        observations, rewards = self._core.observations(now), self._core.rewards(now)
        return observations, rewards, now["terminated"], now["truncated"], infos

    def _final(
        self, last: "_core.EnvArrays", ended: NDArray[np.intp], order: NDArray[np.intp], count: int
    ) -> dict[str, Any]:
        """Tell of the episodes that ended: rows `order` of `last` belong to the rows `ended` of the step."""
        observations = self._core.observations(last)
        final_obs = np.full(count, None, dtype=object)
        for target, source in zip(ended, order, strict=True):
            final_obs[target] = (
                {name: rows[source] for name, rows in observations.items()}
                if isinstance(observations, dict)
                else observations[source]
            )
        info = _scattered(_rows(self._core.columns(last), order), ended, count)
        return {
            "final_obs": final_obs,
            "_final_obs": _mask(ended, count),
            "final_info": info,
            "_final_info": _mask(ended, count),
        }


def autoreset(given: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(given)
    except ValueError:
        known = ", ".join(mode.value for mode in AutoresetMode)
        raise ConfigError(f"there is no autoreset mode {given!r}; choose from {known}") from None


def _reset_mask(given: Any, count: int) -> NDArray[np.bool_] | None:
    if given is None:
        return None
    if not isinstance(given, np.ndarray) or given.dtype != np.bool_ or given.shape != (count,):
        raise ConfigError(f"reset_mask must be an array of {count} bool")
    if not given.any():
        raise ConfigError("reset_mask names no environment; give at least one True")
    return np.ascontiguousarray(given)


def _mask(rows: NDArray[np.intp], count: int) -> NDArray[np.bool_]:
    mask = np.zeros(count, dtype=np.bool_)
    mask[rows] = True
    return mask


def _rows(columns: dict[str, Any], rows: NDArray[np.intp]) -> dict[str, Any]:
    """Take some rows of all columns."""
    return {name: _rows(v, rows) if isinstance(v, dict) else v[rows] for name, v in columns.items()}


def _full(columns: dict[str, Any], count: int) -> dict[str, Any]:
    """Give every column its mask: all rows have one."""
    infos: dict[str, Any] = {}
    every = np.ones(count, dtype=np.bool_)
    for name, values in columns.items():
        infos[name] = _full(values, count) if isinstance(values, dict) else values
        infos[f"_{name}"] = every.copy()
    return infos


def _scattered(columns: dict[str, Any], rows: NDArray[np.intp], count: int) -> dict[str, Any]:
    """Put columns of a few rows into columns of `count`, with their masks; elsewhere stands zero, or None."""
    infos: dict[str, Any] = {}
    for name, values in columns.items():
        if isinstance(values, dict):
            infos[name] = _scattered(values, rows, count)
        else:
            infos[name] = np.full(count, None if values.dtype == object else 0, dtype=values.dtype)
            infos[name][rows] = values
        infos[f"_{name}"] = _mask(rows, count)
    return infos
