"""Gymnasium environments; they are registered once `graspbox` and `gymnasium` are imported.

| id | task |
|---|---|
| ``graspbox/GraspPose-v0`` | one decision per episode: a hand pose and a preshape |
| ``graspbox/Grasp-v0`` | closed loop: move the hand, close it, lift |
| ``graspbox/Clear-v0`` | clear a table or a bin of several objects: a decision a step |
| ``graspbox/Reach-v0`` | goal task: the hand's grasp centre to a position |
| ``graspbox/Place-v0`` | goal task: the object to a position on the table or above |

``GraspPose-v0`` sets ``reward_threshold`` to 0.9: with its default ``reward="sparse"``, nine of ten episodes succeed.

Worker processes of Gymnasium's ``AsyncVectorEnv`` and Stable-Baselines3's ``SubprocVecEnv`` know the ids if the program
imported graspbox before it started them. For others started by ``spawn`` or ``forkserver``, an id that includes the
module works everywhere: ``gymnasium.make("graspbox:graspbox/Grasp-v0")``.

An environment works only in the process that made it, because a forked process does not inherit its threads; in any
other process it raises an error. Environments can be pickled and copied.
"""

import gymnasium
from gymnasium.vector.utils import CloudpickleWrapper

from graspbox._common.imports import import_in_workers

#: Ids of grasping tasks. The conformance tests cover them and `GOAL_IDS`.
IDS = ("graspbox/GraspPose-v0", "graspbox/Grasp-v0", "graspbox/Clear-v0")
#: Those whose episode is an attempt on one object.
SINGLE_OBJECT_IDS = IDS[:2]
#: Those of goal tasks, for hindsight experience replay.
GOAL_IDS = ("graspbox/Reach-v0", "graspbox/Place-v0")
#: Observations of goal tasks.
GOAL_OBSERVATIONS = ("observation", "achieved_goal", "desired_goal")
#: Those in which policies are evaluated: an episode is an attempt on one object, or has one goal.
EVALUATED_IDS = (*SINGLE_OBJECT_IDS, *GOAL_IDS)

#: Episodes of ``graspbox/Grasp-v0`` are truncated after this number of steps unless ``max_episode_steps`` is set.
MAX_EPISODE_STEPS = 40
#: Episodes of goal tasks are truncated after this number of steps unless ``max_episode_steps`` is set.
GOAL_STEPS = 50
#: Episodes of ``graspbox/Clear-v0`` are truncated after this number of attempts unless ``max_episode_steps`` is set.
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
    )
    gymnasium.register(
        id=IDS[2],
        entry_point="graspbox.envs.clear:ClearEnv",
        vector_entry_point="graspbox.envs.clear:ClearVectorEnv",
        max_episode_steps=MAX_ATTEMPTS,
    )
    for env_id, name in zip(GOAL_IDS, ("Reach", "Place"), strict=True):
        module = f"graspbox.envs.goal_tasks.{name.lower()}"
        gymnasium.register(
            id=env_id,
            entry_point=f"{module}:{name}Env",
            vector_entry_point=f"{module}:{name}VectorEnv",
            max_episode_steps=GOAL_STEPS,
        )


register()
import_in_workers(CloudpickleWrapper)
