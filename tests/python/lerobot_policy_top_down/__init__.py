"""The grasp of `top_down` as a policy of LeRobot, for tests of its real ``lerobot-eval``."""

from lerobot_policy_top_down.configuration_top_down import TopDownConfig

__all__ = ["TopDownConfig"]
