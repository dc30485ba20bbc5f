"""Gymnasium environments; importing `graspbox` registers them.

| id | what it is |
|---|---|
| ``graspbox/GraspPose-v0`` | one decision an episode: where to put the hand, and how |
| ``graspbox/Grasp-v0`` | closed loop at 20 Hz: move the hand, close it, lift |
"""

import gymnasium

#: Every id that the package registers; the conformance tests run over all of them.
IDS = ("graspbox/GraspPose-v0", "graspbox/Grasp-v0")

#: An episode of ``graspbox/Grasp-v0`` is cut off after so many steps where ``max_episode_steps`` names no other.
MAX_EPISODE_STEPS = 200


def register() -> None:
    """Register every environment, once."""
    if IDS[0] in gymnasium.registry:
        return
    gymnasium.register(
        id=IDS[0],
        entry_point="graspbox.envs.grasp_pose:GraspPoseEnv",
        vector_entry_point="graspbox.envs.grasp_pose:GraspPoseVectorEnv",
    )
    gymnasium.register(
        id=IDS[1],
        entry_point="graspbox.envs.grasp:GraspEnv",
        vector_entry_point="graspbox.envs.vector:GraspVectorEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
    )
