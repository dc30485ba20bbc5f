"""Goal tasks: bring the hand, or the object, to a position. For hindsight experience replay (HER).

| id | what is to reach the goal | module |
|---|---|---|
| ``graspbox/Reach-v0`` | the hand's grasp centre | `graspbox.envs.goal_tasks.reach` |
| ``graspbox/Place-v0`` | the object's centre of mass | `graspbox.envs.goal_tasks.place` |

They have the interface of Fetch (Gymnasium-Robotics) and panda-gym: observations are a ``Dict`` of exactly
``observation``, ``achieved_goal`` and ``desired_goal``, and ``env.unwrapped.compute_reward(achieved_goal, desired_goal,
info)`` gives the reward of any pair of goals, one or many. The reward of a step is that of its observation.

>>> import gymnasium, graspbox
>>> env = gymnasium.make("graspbox/Reach-v0")
>>> seen, info = env.reset(seed=0, options={"goal": [0.1, 0.0, 0.3]})
>>> seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
>>> env.unwrapped.compute_reward(seen["achieved_goal"], seen["desired_goal"], {}) == reward
np.True_

Keywords
--------
`graspbox.envs.settings.GoalTaskConfig` documents them, `graspbox.envs.settings.GraspConfig` the others; a vector
environment (``gymnasium.make_vec``) also has those of `graspbox.envs.settings.VectorConfig`. An action is that of
`graspbox.envs.grasp`, by default with ``control="top_down"``: a velocity along the world's x, y and z and about the
vertical, and the fingers (5 Hz). ``max_episode_steps`` is 50 by default.

Observation
-----------
| key | space | meaning |
|---|---|---|
| observation | that of ``obs`` | a vector or an image of `graspbox.envs.grasp`; those with the object are **privileged** |
| achieved_goal | ``Box(-1, 1, (3,), float32)`` | position that is to reach the goal, world, m; **privileged** |
| desired_goal | ``Box(-1, 1, (3,), float32)`` | the goal, world, m |

Reward
------
``reward="sparse"`` is 0 within ``threshold`` of the goal, else -1; ``reward="dense"`` is minus the distance from the
goal, in metres. There are no other terms: a learner that relabels goals computes the same reward as the environment.

<!-- generated: reward of goal tasks -->

| term | min | max | meaning |
|---|---|---|---|
| goal | -1 | 0 | 0 within the threshold of the goal, else -1 |
| distance | -3.4641 | 0 | minus the distance from the goal, metres |

<!-- end -->

End
---
An episode is truncated after its last step. It does not end at success, nor when the object is lost: HER relabels
rewards and not ends, so that a state would have two values, and an end would be better than -1 in every further step.
``terminate_on_success=True`` ends it at success, for other learners. An episode whose simulation diverges ends too.

Info
----
<!-- generated: info of goal tasks -->

| entry | type | unit | meaning |
|---|---|---|---|
| is_success | bool |  | the achieved goal is within the threshold of the desired one |
| lift | float | m | rise of the object's centre of mass above its resting height |
| object | str |  | name of the object |
| resting | int |  | index of the object's resting pose; -1 if it was dropped at a given pose, or lies among others |
| fits | bool |  | the object's least width in plan view, as the episode begins, is within the width that the hand states; True for a hand that states none |
| touches | bool |  | the hand touches the object |
| protective_stop | bool |  | the protective stop held the hand at some time in the last step |
| reward_terms | dict |  | reward terms of the last step (float) by name; zeros after a reset |

<!-- end -->

Options of a reset
------------------
Those of a single object in `graspbox.envs.grasp`, and ``goal``: x, y, z in metres, in the workspace (0.35 m to each
side, up to 0.75 m above the table). Otherwise a goal is sampled from the seed's stream.

With Stable-Baselines3: ``SAC("MultiInputPolicy", graspbox.sb3.VecEnv.make("graspbox/Reach-v0", 1),
replay_buffer_class=HerReplayBuffer)``; normalize observations (``VecNormalize``).
"""  # noqa: E501 (tables)

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.envs.single import SingleEnv
from graspbox.envs.vector import EnvView, NativeVectorEnv

__all__ = ["GoalEnv", "GoalEnvView", "GoalNativeVectorEnv"]


class GoalEnv(SingleEnv):
    """Base of single environments with goals: `graspbox.envs.single.SingleEnv` with a reward of any goals."""

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Compute the reward of goals; needs neither `info` nor the state of the environment.

        Parameters
        ----------
        achieved_goal, desired_goal : (3,) or (n, 3) array
            Positions, metres.
        info : object
            Ignored.

        Returns
        -------
        float64, or (n,) float64
            The reward of each pair.

        Raises
        ------
        ConfigError
            For arrays of other shapes.
        """
        return self._core.goal_rewards(achieved_goal, desired_goal)


class GoalEnvView(EnvView):
    """One environment of a vector environment with goals."""

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Compute the reward of goals, as `GoalEnv.compute_reward`."""
        found: GoalNativeVectorEnv = self._vector  # type: ignore[assignment]
        return found.compute_reward(achieved_goal, desired_goal, info)


class GoalNativeVectorEnv(NativeVectorEnv):
    """Base of vector environments with goals."""

    _view_class = GoalEnvView

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> NDArray[np.float64]:
        """Compute the reward of goals, as `GoalEnv.compute_reward`."""
        found: NDArray[np.float64] = self._core.goal_rewards(achieved_goal, desired_goal)
        return found
