"""graspbox as an environment of LeRobot: ``lerobot-eval --env.type=graspbox``.

LeRobot imports this package by its name, and importing it registers `GraspboxEnv`.

| module | purpose |
|---|---|
| `lerobot_env_graspbox.configuration` | the settings of the environments, and their features |
| `lerobot_env_graspbox.vector` | many environments in one process, with LeRobot's names |
"""

from .configuration import GraspboxEnv
from .vector import LeRobotVectorEnv, make

__all__ = ["GraspboxEnv", "LeRobotVectorEnv", "make"]
