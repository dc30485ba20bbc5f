"""Settings; LeRobot finds the modules beside this one by their names."""

from dataclasses import dataclass
from typing import Any

from lerobot.configs import PreTrainedConfig

__all__ = ["TopDownConfig"]


@PreTrainedConfig.register_subclass("top_down")
@dataclass
class TopDownConfig(PreTrainedConfig):  # type: ignore[misc]
    """Settings of the policy.

    Attributes
    ----------
    control : str
        The control mode; ``grasp_pose`` is that of ``GraspPose-v0``.
    fingers, control_freq
        Those of the environment.
    """

    control: str = "twist"
    fingers: str = "synergy"
    control_freq: float = 5.0

    observation_delta_indices = None
    action_delta_indices = None
    reward_delta_indices = None

    def get_optimizer_preset(self) -> Any:
        """Refuse: it does not learn."""
        raise NotImplementedError

    def get_scheduler_preset(self) -> Any:
        """Refuse: it does not learn."""
        raise NotImplementedError

    def validate_features(self) -> None:
        """Take any."""
