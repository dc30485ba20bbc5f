"""``graspbox/Reach-v0``: bring the hand's grasp centre to a position.

The task and its interface are those of `graspbox.envs.goal_tasks`. The start is that of `graspbox.envs.grasp`: the open
hand above an object near the middle of the table. The object is scenery; by default it is one small box, which is ready
at once. A goal is within 0.15 m of the table's middle along x and y, 0.05 to 0.30 m above the object's highest point,
and at most 0.5 m above the table. The achieved goal is the true grasp centre, between the fingers, in front of the
palm. Success is a distance of at most 0.05 m (``threshold``), as in
Fetch and panda-gym.

``observation`` is ``proprio`` by default, which sees no object.

Version history
---------------
v0: first version.
"""

from typing import Any

from graspbox.envs.goal_tasks import GoalEnv, GoalNativeVectorEnv
from graspbox.envs.settings import ObjectsArgument, ReachConfig, ReachVectorConfig

__all__ = ["ReachEnv", "ReachVectorEnv"]

#: The object on the table.
OBJECT = "procedural:box:0"


class ReachEnv(GoalEnv, config=ReachConfig):
    """One environment of ``Reach-v0``: see the module, and `graspbox.envs.single.SingleEnv` for its methods."""

    def __init__(self, objects: ObjectsArgument = OBJECT, **keywords: Any) -> None:
        super().__init__(objects, **keywords)


class ReachVectorEnv(GoalNativeVectorEnv, config=ReachVectorConfig):
    """Vector environment of ``Reach-v0``: each equals the single one bit for bit."""

    def __init__(self, num_envs: int = 1, objects: ObjectsArgument = OBJECT, **keywords: Any) -> None:
        super().__init__(num_envs, objects, **keywords)
