"""The native vector environments as Stable-Baselines3 takes them.

It knows no vector environments of Gymnasium: episodes begin anew in the step that ends them, the last observation is in
the info, and infos are a list of dictionaries. Here each of them is made from one native step.

>>> from stable_baselines3 import PPO
>>> from graspbox.sb3 import VecEnv
>>> env = VecEnv.make("graspbox/Grasp-v0", num_envs=2, objects="procedural:can:0", reward="dense")
>>> model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, device="cpu").learn(16)
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from graspbox.envs.core import options_json, row
from graspbox.errors import ConfigError, MissingExtraError

try:
    from stable_baselines3.common.vec_env import VecEnv as _VecEnv
except ModuleNotFoundError as error:
    if error.name not in ("stable_baselines3", "torch"):
        raise
    message = "graspbox.sb3 needs stable-baselines3: pip install 'graspbox[train]'"
    raise MissingExtraError(message) from None

__all__ = ["VecEnv"]

#: Methods that an environment has by itself.
_PER_ENV = ("get_state", "set_state", "cameras")


class VecEnv(_VecEnv):  # type: ignore[misc]
    """A native vector environment for Stable-Baselines3.

    Infos hold what the single environment says, ``TimeLimit.truncated``, and in the last step of an episode
    ``terminal_observation``.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        One of graspbox's, with ``autoreset_mode="SameStep"``.

    Raises
    ------
    ConfigError
        If the environment resets in another way, or overwrites the observations that it gave.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ConfigError(
                "Stable-Baselines3 resets in the step that ends an episode; use autoreset_mode='SameStep'"
            )
        if not getattr(env.unwrapped, "copy", True):
            raise ConfigError(
                "learners keep observations beside the next ones, which copy=False overwrites; use copy=True"
            )
        self.env = env
        self._actions: NDArray[np.float32] | None = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = env.metadata

    @classmethod
    def make(cls, env_id: str, num_envs: int, **settings: Any) -> "VecEnv":
        """Make one from an id, as ``gymnasium.make_vec`` does."""
        settings["autoreset_mode"] = AutoresetMode.SAME_STEP
        return cls(gymnasium.make_vec(env_id, num_envs=num_envs, **settings))

    def reset(self) -> Any:
        """Begin episodes, with the seeds and options that were set before; returns the observations."""
        if len({options_json(options) for options in self._options}) > 1:
            raise ConfigError("the options of a reset must be the same for all environments")
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        observations, infos = self.env.reset(seed=seeds, options=self._options[0] or None)  # type: ignore[arg-type]
        self.reset_infos = _listed(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Act in every environment.

        Returns
        -------
        observations, rewards, dones, infos
            As Stable-Baselines3 wants them.
        """
        if self._actions is None:
            raise ConfigError("call step_async before step_wait")
        observations, rewards, terminated, truncated, found = self.env.step(self._actions)
        self._actions = None
        infos = _listed(found, self.num_envs)
        dones = terminated | truncated
        for i in np.flatnonzero(dones).tolist():
            self.reset_infos[i] = infos[i]
            infos[i] = row(_unmasked(found["final_info"]), i)
            infos[i]["terminal_observation"] = found["final_obs"][i]
        for info, late in zip(infos, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = late
        return observations, rewards.astype(np.float32), dones, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Read an attribute: all environments share it, but for the seeds of their streams."""
        if attr_name in ("observation_space", "action_space"):
            # What Stable-Baselines3 knows is one environment's.
            attr_name = f"single_{attr_name}"
        value = getattr(self.env, attr_name)
        return [value[i] if attr_name == "np_random_seed" else value for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute: all environments share it.

        Raises
        ------
        ConfigError
            If it is to be set for some of them.
        """
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ConfigError(f"{attr_name!r} belongs to all environments together; set it without indices")
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call ``get_state``, ``set_state`` or ``cameras`` of some environments.

        Raises
        ------
        ConfigError
            For a method that a single one of them does not have.
        """
        if method_name not in _PER_ENV:
            raise ConfigError(f"an environment has no method {method_name!r} here; choose from {', '.join(_PER_ENV)}")
        method, which = getattr(self.env, method_name), self._get_indices(indices)
        if method_name == "cameras":
            found = method(*method_args, **method_kwargs).items()
            return [{name: (intrinsics, poses[i]) for name, (intrinsics, poses) in found} for i in which]
        return [method(index, *method_args, **method_kwargs) for index in which]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Tell that no wrapper stands between: wrap this in ``VecMonitor`` and the like."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Any]:
        """Render every environment; None where the render mode is None."""
        frames = None if self.render_mode is None else self.env.render()
        return [None] * self.num_envs if frames is None else list(frames)


def _unmasked(infos: dict[str, Any]) -> dict[str, Any]:
    """Leave the masks out."""
    return {
        name: _unmasked(values) if isinstance(values, dict) else values
        for name, values in infos.items()
        if not name.startswith("_") and name not in ("final_obs", "final_info")
    }


def _listed(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Turn columns into a dictionary for each environment."""
    columns = _unmasked(infos)
    names = list(columns)
    lists = [_listed(v, count) if isinstance(v, dict) else v.tolist() for v in columns.values()]
    return [dict(zip(names, values, strict=True)) for values in zip(*lists, strict=True)]
