"""The grasp that a policy finds in one depth image, as an observation of ``Grasp-v0``: the goal of the hand.

A policy that acts in every step, such as a clone tuned by rewards, need not look at images itself. Another one
(`DepthGrasp`, `HeadGrasp`) looks once, as soon as the hand is out of the camera's image, and from then on the
observation ``goal`` is the pose of its grasp relative to the hand. Nothing of it is privileged. Until then, and
without a grasp, ``goal`` is zero. `graspbox.sb3.goal_env` makes environments of it, in which rewards teach.

>>> from graspbox import evaluation, policies
>>> from graspbox.policies.goals import GoalPolicy
>>> def down(seen):
...     return np.tile(np.float32([0, 0, -0.1, *4 * [0], 1 / 3]), (len(seen["goal"]), 1))
>>> policy = GoalPolicy(policies.load("partial_view_planner"), down)
>>> results = evaluation.evaluate(policy, "graspbox/Grasp-v0", "procedural:can:0", trials=1, max_episode_steps=5)
>>> results.trials[0].steps
5
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError
from graspbox.perception.finder import FoundGrasp
from graspbox.policies._executor import GraspExecutor
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.depth import DepthPolicy
from graspbox.policies.published.configs import GOAL_NAME

__all__ = ["GOAL", "GOAL_NAME", "GoalPolicy", "Goals", "goal_space", "plain_settings"]

#: Entries of the observation, in order: name, number, least and greatest value, meaning.
GOAL: tuple[tuple[str, int, float, float, str], ...] = (
    ("shift", 3, -10.0, 10.0, "from the hand to the grasp, hand axes, in units of 0.1 m"),
    ("turn", 6, -1.0, 1.0, "x axis of the grasp in the hand's axes, then its y axis"),
    ("preshape", 1, 0.0, 1.0, "share of the preshape's range"),
    ("top", 1, 0.0, 10.0, "height of the object over the table, as it is seen, in units of 0.1 m"),
    ("score", 1, -10.0, 10.0, "score of the grasp, clipped"),
    ("time", 1, 0.0, 10.0, "since it has looked, in units of 10 s"),
    ("found", 1, 0.0, 1.0, "1 where there is a grasp, else 0, as is everything else"),
)
#: Units of lengths and of the time, metres and seconds.
_LENGTH, _TIME = 0.1, 10.0
_LOW, _HIGH = (np.repeat([row[i] for row in GOAL], [row[1] for row in GOAL]).astype(np.float32) for i in (2, 3))


def goal_space() -> spaces.Box:
    """Return the space of the observation of one environment: (14,) float32."""
    return spaces.Box(_LOW, _HIGH)


class Goals:
    """The goals of a policy that looks once, in environments of ``Grasp-v0``.

    `base` is a policy of one depth image without oracles, such as `DepthGrasp`; another one raises ConfigError.
    """

    def __init__(self, base: Policy) -> None:
        if not isinstance(base, DepthPolicy) or "state" in base.obs:
            raise ConfigError(
                f"goals come from a policy that looks once, at a depth image, such as policies/depth, not from "
                f"{base.name!r}"
            )
        self.base = base

    def bind(self, task: Task) -> None:
        """Prepare for environments; raises as `Policy.bind`, and for others than those of ``Grasp-v0``."""
        if not task.closed_loop:
            raise ConfigError(f"goals are for graspbox/Grasp-v0, not for {task.env_id!r}")
        self.base.bind(task)
        self._since = np.zeros(task.num_envs)
        self._period = 1.0 / task.control_freq
        self._shown: list[FoundGrasp | None] = [None] * task.num_envs

    def look(self, observation: Mapping[str, NDArray[Any]]) -> None:
        """Take the pending image once the hand is out of view."""
        for env in range(len(self._since)):
            if not self.base.has_looked(env):
                self.base.look(env, {name: observation[name][env] for name in self.base.needed})

    def show(self, proprio: NDArray[Any], *, stepped: bool = True) -> NDArray[np.float32]:
        """Return the goals (n, 14), for the observation ``proprio`` (n, k).

        Call it once after every step of the environments, or with ``stepped=False`` if they have not moved since.
        """
        rows = np.zeros((len(self._since), len(_LOW)), dtype=np.float32)
        for env in range(len(rows)):
            grasp = self.base.found[env] if self.base.has_looked(env) else None
            same = grasp is not None and self._shown[env] is grasp
            self._since[env] = self._since[env] + stepped * self._period if same else 0.0
            self._shown[env] = grasp
            rows[env] = self._row(env, proprio[env], self._since[env])
        return rows

    def after(self, env: int, proprio: NDArray[Any]) -> NDArray[np.float32]:
        """Return the goal (14,) of one environment after a step that ends its episode, for ``proprio`` (k,)."""
        return self._row(env, proprio, self._since[env] + self._period)

    def _row(self, env: int, proprio: NDArray[Any], since: float) -> NDArray[np.float32]:
        grasp = self._shown[env]
        if grasp is None:
            return np.zeros_like(_LOW)
        assert isinstance(self.base.executor, GraspExecutor)
        goal = np.linalg.inv(self.base.executor.hand_pose({"proprio": proprio})) @ grasp.world_from_hand
        low, high = self.base.hand.preshape_limits
        share = (grasp.preshape - low) / (high - low) if high > low else 0.0
        shift, top = goal[:3, 3] / _LENGTH, grasp.top / _LENGTH
        row = [*shift, *goal[:3, 0], *goal[:3, 1], share, top, grasp.score, since / _TIME, 1.0]
        return np.clip(np.array(row, dtype=np.float32), _LOW, _HIGH)


class GoalPolicy(Policy):
    """A policy of ``Grasp-v0`` that also observes the goal of another policy.

    Parameters
    ----------
    base : DepthPolicy
        The policy that looks; see `Goals`.
    decide : callable
        From observations by their names, ``goal`` among them, to actions (n, k): ``ModelPolicy(model).act`` of
        `graspbox.sb3.policy`, or any function.
    names : sequence of str
        Its other observations.
    name : str
        Name in results.
    """

    env_id = "graspbox/Grasp-v0"

    def __init__(
        self,
        base: Policy,
        decide: Callable[[dict[str, NDArray[Any]]], ArrayLike],
        names: Sequence[str] = (),
        name: str = "goal",
    ) -> None:
        self.base, self.goals, self._decide = base, Goals(base), decide
        self.learned_from = base.learned_from
        self._names = tuple(one for one in names if one != GOAL_NAME)
        plain = plain_settings({"obs": (*self._names, GOAL_NAME)}, base)
        self.name, self.obs, self.settings = name, plain.pop("obs"), plain

    def _bind(self, task: Task) -> None:
        self.goals.bind(task)

    def act(self, observation: Any) -> Actions:
        """Look if an episode has begun, and decide."""
        self.goals.look(observation)
        seen = {name: observation[name] for name in self._names}
        actions = self._decide({**seen, GOAL_NAME: self.goals.show(observation["proprio"])})
        return np.asarray(actions, dtype=np.float32)


def plain_settings(settings: Mapping[str, Any], base: Policy) -> dict[str, Any]:
    """Return the keywords of environments that show all that a policy with goals and its base observe, but no goal."""
    names = [name for name in settings["obs"] if name != GOAL_NAME]
    needed = (base.obs,) if isinstance(base.obs, str) else base.obs or ()
    kept = {name: value for name, value in settings.items() if name != "goal_from"}
    return {**base.settings, **kept, "obs": tuple(dict.fromkeys([*names, *needed]))}
