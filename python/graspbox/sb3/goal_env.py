"""``Grasp-v0`` in which an agent observes the grasp of another policy: the observation ``goal``.

That policy decides once per episode, as soon as the hand has left the camera's image (`graspbox.policies.goals`); the
agent acts in every step. Rewards, infos and seeds are those of the environment. The keyword ``goal_from`` names the
folder of the goal policy.

>>> from graspbox.sb3.goal_env import make_vec
>>> envs = make_vec(
...     "graspbox/Grasp-v0", 2, objects="procedural:can:0-3", obs=("proprio", "goal"),
...     goal_from="partial_view_planner", control_freq=5, autoreset_mode="SameStep",
... )
>>> seen, info = envs.reset(seed=0)
>>> sorted(seen), seen["goal"].shape
(['goal', 'proprio'], (2, 14))
>>> seen, reward, terminated, truncated, info = envs.step(envs.action_space.sample())

With Stable-Baselines3: ``graspbox.sb3.VecEnv(envs)``.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from graspbox import policies
from graspbox.errors import ConfigError
from graspbox.policies.base import Policy, Task
from graspbox.policies.goals import GOAL_NAME, GoalPolicy, Goals, goal_space, plain_settings

__all__ = ["GoalVectorEnv", "goal_base", "make_vec", "with_goals"]

Step = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


def make_vec(env_id: str, num_envs: int, **settings: Any) -> VectorEnv[Any, Any, Any]:
    """Make environments as ``gymnasium.make_vec`` does; with the keyword ``goal_from`` their agent observes goals.

    Parameters
    ----------
    env_id : str
        One of `graspbox.envs.SINGLE_OBJECT_IDS`.
    num_envs : int
        Number of environments.
    **settings
        Keywords of the environments, ``obs`` with ``"goal"`` among them, and ``goal_from``: the goal policy's folder
        or name, as for `graspbox.policies.load`. Without ``goal_from`` these are plain environments.

    Raises
    ------
    ConfigError
        As `with_goals` and `GoalVectorEnv`.
    """
    base = goal_base(settings)
    if base is None:
        return gymnasium.make_vec(env_id, num_envs=num_envs, **settings)
    envs = gymnasium.make_vec(env_id, num_envs=num_envs, **plain_settings(settings, base))
    return GoalVectorEnv(envs, base, settings["obs"])


class GoalVectorEnv(VectorWrapper[Any, Any, Any, Any, Any]):
    """Environments of ``Grasp-v0`` whose agent observes the grasp of another policy.

    Parameters
    ----------
    env : VectorEnv
        Of ``graspbox/Grasp-v0``, with ``autoreset_mode="SameStep"`` and the keywords that
        `graspbox.policies.goals.plain_settings` returns.
    base : DepthGrasp
        The goal policy; see `graspbox.policies.goals.Goals`.
    names : sequence of str
        The agent's observations, ``"goal"`` among them.

    Attributes
    ----------
    goals : Goals
        The goals of the current episodes.

    Raises
    ------
    ConfigError
        For other environments, or a base policy that cannot decide there.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], base: Policy, names: Sequence[str]) -> None:
        super().__init__(env)
        if env.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            raise ConfigError("goals need environments with autoreset_mode='SameStep'")
        self.goals = Goals(base)
        self.goals.bind(Task.of(env))
        self._names = tuple(name for name in names if name != GOAL_NAME)
        observed: Any = env.single_observation_space
        boxes = {name: observed[name] for name in self._names} | {GOAL_NAME: goal_space()}
        self.single_observation_space = spaces.Dict(boxes)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Begin episodes, as the environment does."""
        # A copy: wrappers such as `RecordEpisodeStatistics` remove the mask from the options.
        observation, info = self.env.reset(seed=seed, options=dict(options or {}))  # type: ignore[arg-type]
        self.goals.base.reset(seed, mask=(options or {}).get("reset_mask"), info=info)
        return self._observe(observation, stepped=False), info

    def step(self, actions: ArrayLike) -> Step:
        """Act, as in the environment; an episode that ends is reset in the same step."""
        observation, rewards, terminated, truncated, info = self.env.step(actions)
        over = terminated | truncated
        for env in np.flatnonzero(over).tolist():
            last = info["final_obs"][env]
            goal = self.goals.after(env, last["proprio"])
            info["final_obs"][env] = {**{name: last[name] for name in self._names}, GOAL_NAME: goal}
        if over.any():
            self.goals.base.reset(mask=over, info=info)
        return self._observe(observation, stepped=True), rewards, terminated, truncated, info

    def _observe(self, observation: Any, *, stepped: bool) -> dict[str, NDArray[Any]]:
        self.goals.look(observation)
        goals = self.goals.show(observation["proprio"], stepped=stepped)
        return {**{name: observation[name] for name in self._names}, GOAL_NAME: goals}


def with_goals(
    policy: Policy, settings: Mapping[str, Any], base: Policy | None = None
) -> tuple[Policy, dict[str, Any]]:
    """Wrap a policy to observe goals if the keywords of its run ask for it.

    Parameters
    ----------
    policy : Policy
        The unbound policy that decides: `graspbox.sb3.policy.ModelPolicy`.
    settings : mapping
        Keywords of environments, with or without ``goal_from``, a folder for `graspbox.policies.load`.
    base : Policy, optional
        The policy of ``goal_from``, if already loaded.

    Returns
    -------
    Policy, dict
        A `GoalPolicy` and keywords without ``goal_from``, or both unchanged.

    Raises
    ------
    ConfigError
        If only one of ``goal_from`` and the observation ``goal`` is present, or ``goal_from`` names another kind of
        policy.
    """
    base = base or goal_base(settings)
    if base is None:
        return policy, dict(settings)
    return GoalPolicy(base, policy.act, settings["obs"], policy.name), plain_settings(settings, base)


def goal_base(settings: Mapping[str, Any]) -> Policy | None:
    """Load the policy of the keyword ``goal_from``; None without it. Raises as `with_goals`."""
    obs, folder = settings.get("obs", ()), settings.get("goal_from")
    wanted = not isinstance(obs, str) and GOAL_NAME in obs
    if (folder is not None) != wanted or obs == GOAL_NAME:
        raise ConfigError(
            f"obs is {obs!r} and goal_from {folder!r}; the observation 'goal' needs other observations, and "
            "goal_from the folder of the policy that sees the image, such as policies/depth"
        )
    return None if folder is None else policies.load(str(folder))
