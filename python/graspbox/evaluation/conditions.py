"""Conditions of an evaluation, one row each.

Each differs from the first in one respect, so a table of them shows the policy's sensitivity to each.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians
from typing import Any

from graspbox.configs import Randomization, ShakeConfig, TrialConfig
from graspbox.configs.cameras import FRONT, CamerasConfig
from graspbox.envs import EVALUATED_IDS
from graspbox.errors import ConfigError

__all__ = ["CONDITIONS", "Condition", "settings_of"]


@dataclass(frozen=True)
class Condition:
    """Its difference from the first condition, the keywords of the environments, and those that support it."""

    meaning: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    env_ids: tuple[str, ...] = EVALUATED_IDS


def _hand(millimetres: float, degrees: float) -> Condition:
    error = Randomization(hand_position=1e-3 * millimetres, hand_rotation=radians(degrees))
    meaning = f"the hand is off by up to {millimetres:g} mm and {degrees:g} degrees along and about each axis"
    return Condition(meaning, {"randomization": error})


def _friction(factor: float) -> Condition:
    return Condition(f"the object's friction times {factor:g}", {"randomization": Randomization((factor, factor))})


#: From the side and steeper than the first camera; 0.60 m away.
_SIDE = replace(FRONT, eye=(0.25, -0.3, 0.5))

#: Conditions by name; the first is the reference.
CONDITIONS: Mapping[str, Condition] = {
    "nominal": Condition("nothing but object, pose and sensor noise varies"),
    "hand_5": _hand(5, 5),
    "hand_10": _hand(10, 10),
    "friction_0.5": _friction(0.5),
    "friction_0.3": _friction(0.3),
    "mass_2": Condition("the object's mass times 2", {"randomization": Randomization(mass=(2.0, 2.0))}),
    "camera": Condition("another camera, from the side and from higher", {"cameras": CamerasConfig(cameras=(_SIDE,))}),
    "calibration": Condition(
        "the camera is up to 10 mm and 1.1 degrees away from its stated pose",
        {"randomization": Randomization(camera_position=0.01, camera_rotation=0.02)},
    ),
    "shake": Condition(
        "a success is shaken with 2 g along and about six axes",
        {"trial": TrialConfig(shake=ShakeConfig())},
        # In the closed loop no shake follows the trial.
        ("graspbox/GraspPose-v0",),
    ),
}


def settings_of(name: str, env_id: str) -> Mapping[str, Any]:
    """Return the keywords of an environment for a condition that it supports."""
    if name not in CONDITIONS:
        raise ConfigError(f"there is no condition {name!r}; choose from {', '.join(CONDITIONS)}")
    known = CONDITIONS[name].env_ids
    if env_id not in known:
        raise ConfigError(f"the condition {name!r} applies only to {', '.join(known)}, not to {env_id}")
    return CONDITIONS[name].settings
