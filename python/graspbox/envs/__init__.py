"""Gymnasium environments; importing `graspbox` registers them.

| id | task |
|---|---|
| ``graspbox/GraspPose-v0`` | one decision per episode: a hand pose and a preshape |
| ``graspbox/Grasp-v0`` | closed loop at 20 Hz: move the hand, close it, lift |
| ``graspbox/Clear-v0`` | clear a table or a bin of several objects: a decision a step |

| module | contents |
|---|---|
| `graspbox.envs.grasp`, `graspbox.envs.grasp_pose`, `graspbox.envs.clear` | the environments: tables of actions, observations, rewards, infos and reset options |
| `graspbox.envs.vector` | many environments stepped by one call, for ``gymnasium.make_vec`` |
| `graspbox.envs._pools.preparation` | objects shared by environments, and their preparation |
| `graspbox.envs.settings` | keywords of the environments |
| `graspbox.envs.coding` | reads poses from states, encodes poses as actions |
| `graspbox.envs.expert` | a scripted expert for ``Grasp-v0`` |
| `graspbox.envs.scripted` | scripted motions, independent of the object |
| `graspbox.envs.reward` | weights of the reward terms |
| `graspbox.envs.spaces` | spaces and tables from the core |

``GraspPose-v0`` and ``Grasp-v0`` set ``reward_threshold`` to 0.9: with ``reward="sparse"``, nine of ten episodes
succeed.

A worker process started by ``spawn`` or ``forkserver`` (the default of Stable-Baselines3's ``SubprocVecEnv``) knows the
ids only after it has imported graspbox. If the program imports it under ``if __name__ == "__main__"``, the workers do
not, and they exit without a message. An id that includes the module works everywhere:
``gymnasium.make("graspbox:graspbox/Grasp-v0")``.

An environment works only in the process that made it, because a forked process does not inherit its threads; in any
other process it raises an error. Environments can be pickled and copied.
"""  # noqa: E501 (a table)

import gymnasium

#: All ids that the package registers; the conformance tests cover each of them.
IDS = ("graspbox/GraspPose-v0", "graspbox/Grasp-v0", "graspbox/Clear-v0")
#: Those whose episode is an attempt on one object.
SINGLE_OBJECT_IDS = IDS[:2]

#: Episodes of ``graspbox/Grasp-v0`` are truncated after this number of steps unless ``max_episode_steps`` is given.
MAX_EPISODE_STEPS = 200
#: Episodes of ``graspbox/Clear-v0`` are truncated after this number of attempts unless ``max_episode_steps`` is given.
MAX_ATTEMPTS = 30
#: With ``reward="sparse"``: nine of ten episodes succeed.
REWARD_THRESHOLD = 0.9


def register() -> None:
    """Register the environments; repeated calls do nothing."""
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
    gymnasium.register(
        id=IDS[2],
        entry_point="graspbox.envs.clear:ClearEnv",
        vector_entry_point="graspbox.envs.clear:ClearVectorEnv",
        max_episode_steps=MAX_ATTEMPTS,
    )
