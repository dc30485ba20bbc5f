"""``graspbox/Place-v0``: bring the object to a position on the table or above it.

The task and its interface are those of `graspbox.envs.goal_tasks`, objects and start those of `graspbox.envs.grasp`. A
goal is within 0.15 m of the table's middle along x and y. With probability 0.5 it is on the table, at the height of the
object's centre of mass at rest, else up to 0.25 m above that. The achieved goal is the object's centre of mass. Success
is a distance of at most 0.04 m (``threshold``); about 3 % of the starts are a success.

``observation`` is ``state`` by default.

Version history
---------------
v0: first version.
"""

from graspbox.envs.goal_tasks import GoalEnv, GoalNativeVectorEnv
from graspbox.envs.settings import PlaceConfig, PlaceVectorConfig

__all__ = ["PlaceEnv", "PlaceVectorEnv"]


class PlaceEnv(GoalEnv, config=PlaceConfig):
    """One environment of ``Place-v0``: see the module, and `graspbox.envs.single.SingleEnv` for its methods."""


class PlaceVectorEnv(GoalNativeVectorEnv, config=PlaceVectorConfig):
    """Vector environment of ``Place-v0``: each equals the single one bit for bit."""
