"""Environments of graspbox with LeRobot's names of observations, as ``lerobot-eval`` needs them.

| graspbox | here | in a policy's batch, and in a data set of ``graspbox export --format lerobot`` |
|---|---|---|
| ``rgb``, ``rgb_palm``, ... | ``pixels``, a dictionary by name, uint8 (H, W, 3) | ``observation.images.rgb`` |
| ``depth``, ``depth_palm``, ... | ``images.depth``, float32 (1, H, W), millimetres | ``observation.images.depth`` |
| ``proprio`` | ``agent_pos`` | ``observation.state`` |
| ``state``, privileged | ``environment_state`` | ``observation.environment_state`` |
| every other | its own name | ``observation.tactile`` |
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from graspbox.tools.demonstrations.lerobot import TASK

__all__ = ["LeRobotVectorEnv", "kind", "make", "renamed"]

#: Option of the resets of ``lerobot-eval``: a rollout begins, of one episode in each environment.
_NEW_ROLLOUT = "lerobot_new_rollout"
_NAMES = {"proprio": "agent_pos", "state": "environment_state"}
#: LeRobot reads depth in millimetres by default.
_MILLIMETRES = 1000.0


def kind(name: str) -> str:
    """Classify an observation of graspbox by its name: ``"rgb"``, ``"depth"`` or ``"other"``."""
    first = name.partition("_")[0]
    return first if first in ("rgb", "depth") else "other"


def renamed(observation: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Convert observations of one or many environments to LeRobot's names, units and order of axes."""
    result: dict[str, Any] = {}
    for name, array in observation.items():
        if kind(name) == "rgb":
            result.setdefault("pixels", {})[name] = array
        elif kind(name) == "depth":
            result[f"images.{name}"] = np.moveaxis(array, -1, -3) * np.float32(_MILLIMETRES)
        else:
            result[_NAMES.get(name, name)] = array
    return result


def _space(space: gymnasium.spaces.Dict) -> gymnasium.spaces.Dict:
    """Space of one environment's observations after `renamed`."""
    low = renamed({name: box.low for name, box in space.items()})
    high = renamed({name: box.high for name, box in space.items()})

    def box(below: Any, above: Any) -> gymnasium.Space[Any]:
        if isinstance(below, dict):
            return gymnasium.spaces.Dict({name: box(below[name], above[name]) for name in below})
        return gymnasium.spaces.Box(below, above, dtype=below.dtype.type)

    return gymnasium.spaces.Dict({name: box(low[name], high[name]) for name in low})


class LeRobotVectorEnv(VectorWrapper):
    """graspbox's native vector environment, for ``lerobot-eval``.

    A rollout of ``lerobot-eval`` lasts until the longest of its episodes has ended, and LeRobot adds the reward of one
    step too many to an episode. So the rewards of an environment are 0 from the end of its episode until the next
    rollout begins. Where no rollout was begun, they are graspbox's.

    Parameters
    ----------
    env : VectorEnv
        Of graspbox, with observations by name and ``autoreset_mode="SameStep"``.
    max_episode_steps : int
        Steps after which its episodes are truncated.
    task : str
        Name of the task.
    task_description : str
        The instruction.
    """

    def __init__(
        self, env: VectorEnv[Any, Any, Any], max_episode_steps: int, task: str, task_description: str = TASK
    ) -> None:
        super().__init__(env)
        self.single_observation_space = _space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._shared = {
            "_max_episode_steps": max_episode_steps,
            "task": task,
            "task_description": task_description,
        }
        self._in_rollout = False
        self._over = np.zeros(env.num_envs, dtype=np.bool_)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; the option with which LeRobot begins a rollout concerns only this wrapper."""
        kept = dict(options or {})
        self._in_rollout = bool(kept.pop(_NEW_ROLLOUT, False))
        self._over[:] = False
        observation, info = self.env.reset(seed=seed, options=kept or None)
        return renamed(observation), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Act; an episode that ends leaves its last observation in ``final_obs``, its end in ``final_info``."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        if self._in_rollout:
            reward = np.where(self._over, 0.0, reward)
            self._over |= terminated | truncated
        if "final_obs" in info:
            last = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(info["_final_obs"]):
                last[row] = renamed(info["final_obs"][row])
            info["final_obs"] = last
        return renamed(observation), reward, terminated, truncated, info

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of every environment, or read an attribute.

        Raises
        ------
        AttributeError
            If an environment has no attribute of this name.
        """
        if name in self._shared:
            return (self._shared[name],) * self.num_envs
        return self.env.call(name, *args, **kwargs)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Read an attribute of every environment; see `call`."""
        return self.call(name)


def make(task: str, n_envs: int, max_episode_steps: int, description: str = TASK, **keywords: Any) -> LeRobotVectorEnv:
    """Make environments.

    Parameters
    ----------
    task : str
        ``Grasp-v0`` or ``GraspPose-v0``.
    n_envs : int
        Number of environments; they are stepped by threads of this process.
    max_episode_steps : int
        Steps after which an episode is truncated.
    description : str
        The instruction.
    **keywords
        Keywords of the environments.

    Raises
    ------
    ConfigError, ObjectSetError
        For a wrong keyword.
    """
    envs = gymnasium.make_vec(
        f"graspbox:graspbox/{task}",
        num_envs=n_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        max_episode_steps=max_episode_steps,
        **keywords,
    )
    return LeRobotVectorEnv(envs, max_episode_steps, task, description)
