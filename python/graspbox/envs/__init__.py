"""Gymnasium environments; importing `graspbox` registers them.

| id | what it is |
|---|---|
| ``graspbox/GraspPose-v0`` | one decision per episode: where to put the hand, and how |
| ``graspbox/Grasp-v0`` | closed loop at 20 Hz: move the hand, close it, lift |

| module | what it does |
|---|---|
| `graspbox.envs.grasp`, `graspbox.envs.grasp_pose` | the two environments: tables of actions, observations, rewards, infos and reset options |
| `graspbox.envs.vector` | many environments in one call, for ``gymnasium.make_vec`` |
| `graspbox.envs.preparation` | objects that environments share, and preparing them all |
| `graspbox.envs.settings` | their keywords |
| `graspbox.envs.coding` | poses in states and actions |
| `graspbox.envs.expert` | a scripted expert for ``Grasp-v0`` |
| `graspbox.envs.scripted` | its motions, without knowledge of an object |
| `graspbox.envs.reward` | weights of the reward terms |
| `graspbox.envs.window` | the window of ``render_mode="human"`` |
| `graspbox.envs.spaces` | spaces and tables from the core |

``reward_threshold`` of both specs is 0.9, for ``reward="sparse"``: nine of ten episodes succeed.

Processes that import a program anew know no id until graspbox is imported there: workers of the start methods
``spawn`` and ``forkserver`` (the default of Stable-Baselines3's ``SubprocVecEnv``) end without a message where ``import
graspbox`` stands under ``if __name__ == "__main__"``. The id with its module works everywhere:
``gymnasium.make("graspbox:graspbox/Grasp-v0")``.

An environment belongs to the process that made it, since a forked process does not have its threads; in another one it
raises an error. Environments can be pickled and copied.
"""  # noqa: E501 (a table)

import gymnasium

#: Every id that the package registers; the conformance tests run over all of them.
IDS = ("graspbox/GraspPose-v0", "graspbox/Grasp-v0")

#: An episode of ``graspbox/Grasp-v0`` is truncated after this number of steps if ``max_episode_steps`` is not given.
MAX_EPISODE_STEPS = 200
#: Nine of ten episodes succeed, with ``reward="sparse"``.
REWARD_THRESHOLD = 0.9


def register() -> None:
    """Register every environment, once."""
    if IDS[0] in gymnasium.registry:
        return
    gymnasium.register(
        id=IDS[0],
        entry_point="graspbox.envs.grasp_pose:GraspPoseEnv",
        vector_entry_point="graspbox.envs.grasp_pose:GraspPoseVectorEnv",
        max_episode_steps=1,
        reward_threshold=REWARD_THRESHOLD,
    )
    gymnasium.register(
        id=IDS[1],
        entry_point="graspbox.envs.grasp:GraspEnv",
        vector_entry_point="graspbox.envs.vector:GraspVectorEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
        reward_threshold=REWARD_THRESHOLD,
    )
