"""The native vector environments for Stable-Baselines3.

Stable-Baselines3 does not support vector environments of Gymnasium: it resets an episode in the step that ends it,
puts the last observation in the info, and lists infos as dictionaries. This adapter converts each native step.

>>> from stable_baselines3 import PPO
>>> from graspbox.sb3 import VecEnv
>>> env = VecEnv.make("graspbox/Grasp-v0", num_envs=2, objects="procedural:can:0", reward="dense")
>>> model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu").learn(16)
"""

import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from graspbox.envs.core import row
from graspbox.envs.vector import EnvView
from graspbox.errors import ConfigError, MissingExtraError

try:
    from stable_baselines3.common.vec_env import VecEnv as _VecEnv
except ModuleNotFoundError as error:
    if error.name not in ("stable_baselines3", "torch"):
        raise
    message = "graspbox.sb3 needs stable-baselines3: pip install 'graspbox[train]'"
    raise MissingExtraError(message) from None

__all__ = ["VecEnv"]

#: Methods of a single environment.
_PER_ENV = ("get_state", "set_state", "cameras", "render")
#: The method that `HerReplayBuffer` calls, of environments with goals.
_REWARD = "compute_reward"


class VecEnv(_VecEnv):  # type: ignore[misc]
    """A native vector environment for Stable-Baselines3.

    Infos are those of the single environment, with ``TimeLimit.truncated``, and in the last step of an episode
    ``terminal_observation`` and ``episode``: its return ``r``, its length ``l`` and the time ``t`` in seconds since
    this environment was made, as ``Monitor`` writes them, so that logs have ``rollout/ep_rew_mean``. ``set_options``
    takes options for all environments, or a list with one dictionary per environment. It can be pickled, as its
    environment can.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        One of graspbox's, with ``autoreset_mode="SameStep"``.

    Raises
    ------
    ConfigError
        If it is not a vector environment, resets in another mode, or overwrites the observations that it returned.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        if not isinstance(env, VectorEnv):
            raise ConfigError(
                f"graspbox.sb3.VecEnv takes a vector environment of Gymnasium, not {type(env).__name__}; "
                "make_vec_env of Stable-Baselines3 makes single environments: use VecEnv.make(env_id, num_envs, ...) "
                "instead, or make_vec_env with DummyVecEnv"
            )
        if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ConfigError(
                "Stable-Baselines3 resets in the step that ends an episode; use autoreset_mode='SameStep'"
            )
        if not getattr(env.unwrapped, "copy", True):
            raise ConfigError(
                "learners keep observations together with the next ones, which copy=False overwrites; use copy=True"
            )
        self.env = env
        self._actions: NDArray[np.float32] | None = None
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, dtype=np.int64)
        self._began = time.time()
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = env.metadata

    @classmethod
    def make(cls, env_id: str, num_envs: int, **settings: Any) -> "VecEnv":
        """Make one from an id, as ``gymnasium.make_vec`` does."""
        settings["autoreset_mode"] = AutoresetMode.SAME_STEP
        return cls(gymnasium.make_vec(env_id, num_envs=num_envs, **settings))

    def reset(self) -> Any:
        """Begin episodes, with the seeds and options set before; returns the observations."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observations, infos = self.env.reset(seed=seeds, options={"each": self._options})  # type: ignore[arg-type]
        self.reset_infos = _listed(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Act in every environment.

        Returns
        -------
        observations, rewards, dones, infos
            In the format of Stable-Baselines3.
        """
        if self._actions is None:
            raise ConfigError("call step_async before step_wait")
        observations, rewards, terminated, truncated, found = self.env.step(self._actions)
        self._actions = None
        self._returns += rewards
        self._lengths += 1
        infos = _listed(found, self.num_envs)
        dones = terminated | truncated
        for i in np.flatnonzero(dones).tolist():
            self.reset_infos[i] = infos[i]
            infos[i] = row(_unmasked(found["final_info"]), i)
            infos[i]["terminal_observation"] = found["final_obs"][i]
            infos[i]["episode"] = self._finished(i)
        for info, late in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = late
        return observations, rewards.astype(np.float32), dones, infos

    def _finished(self, i: int) -> dict[str, Any]:
        """Return the statistics of the episode that ended in an environment, and begin those of the next."""
        took = time.time() - self._began
        found = {"r": round(float(self._returns[i]), 6), "l": int(self._lengths[i]), "t": round(took, 6)}
        self._returns[i], self._lengths[i] = 0.0, 0
        return found

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Read an attribute of each environment, or one of the vector environment that they share."""
        which = list(self._get_indices(indices))
        views = [self._views[i] for i in which]
        if all(hasattr(view, attr_name) for view in views):
            return [getattr(view, attr_name) for view in views]
        return [getattr(self.env, attr_name)] * len(which)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of some environments, to be read by `get_attr`.

        Raises
        ------
        ConfigError
            For an attribute that all environments share.
        """
        for i in self._get_indices(indices):
            try:
                setattr(self._views[i], attr_name, value)
            except AttributeError:
                raise ConfigError(f"{attr_name!r} is shared by all environments; give it to VecEnv.make") from None

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call ``get_state``, ``set_state``, ``cameras``, ``render`` or a goal task's ``compute_reward``.

        Raises
        ------
        ConfigError
            For a method that single environments do not have.
        """
        views = [self._views[i] for i in self._get_indices(indices)]
        known = (*_PER_ENV, *([_REWARD] if all(hasattr(view, _REWARD) for view in views) else []))
        if method_name not in known:
            raise ConfigError(f"an environment has no method {method_name!r} here; choose from {', '.join(known)}")
        return [getattr(view, method_name)(*method_args, **method_kwargs) for view in views]

    @property
    def _views(self) -> tuple[EnvView, ...]:
        found: tuple[EnvView, ...] = self.env.unwrapped.envs  # type: ignore[attr-defined]
        return found

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Report no wrappers: those of Stable-Baselines3, such as ``VecMonitor``, go around this environment."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Any]:
        """Render every environment; None if the render mode is None."""
        frames = None if self.render_mode is None else self.env.render()
        return [None] * self.num_envs if frames is None else list(frames)


def _unmasked(infos: dict[str, Any]) -> dict[str, Any]:
    """Remove the masks."""
    return {
        name: _unmasked(values) if isinstance(values, dict) else values
        for name, values in infos.items()
        if not name.startswith("_") and name not in ("final_obs", "final_info")
    }


def _listed(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Convert columns to one dictionary per environment."""
    columns = _unmasked(infos)
    names = list(columns)
    lists = [_listed(v, count) if isinstance(v, dict) else v.tolist() for v in columns.values()]
    return [dict(zip(names, values, strict=True)) for values in zip(*lists, strict=True)]
