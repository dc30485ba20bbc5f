"""Gymnasium environments; importing `graspbox` registers them.

| id | what it is |
|---|---|
| ``graspbox/GraspPose-v0`` | one decision an episode: where to put the hand, and how |
"""

import gymnasium

#: Every id that the package registers; the conformance tests run over all of them.
IDS = ("graspbox/GraspPose-v0",)


def register() -> None:
    """Register every environment, once."""
    if IDS[0] not in gymnasium.registry:
        gymnasium.register(id=IDS[0], entry_point="graspbox.envs.grasp_pose:GraspPoseEnv")
