"""Export of demonstrations (`graspbox.data.episodes`) to the formats of LeRobot and Minari."""

from graspbox.tools.demonstrations.lerobot import to_lerobot
from graspbox.tools.demonstrations.minari import to_minari

__all__ = ["to_lerobot", "to_minari"]
