"""Conditions under which a policy of ``GraspPose-v0`` is measured: one row each.

Each differs from the first in one thing, so that a table of them tells what a policy depends on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians
from typing import Any

from graspbox.camera_configs import FRONT, CamerasConfig
from graspbox.configs import Randomization, ShakeConfig, TrialConfig

__all__ = ["CONDITIONS", "Condition"]


@dataclass(frozen=True)
class Condition:
    """One condition.

    Attributes
    ----------
    meaning : str
        What differs.
    settings : mapping
        Keywords of the environments.
    """

    meaning: str
    settings: Mapping[str, Any] = field(default_factory=dict)


def _hand(millimetres: float, degrees: float) -> Condition:
    error = Randomization(hand_position=1e-3 * millimetres, hand_rotation=radians(degrees))
    meaning = f"the hand is off by up to {millimetres:g} mm and {degrees:g} degrees along and about each axis"
    return Condition(meaning, {"randomization": error})


def _friction(factor: float) -> Condition:
    return Condition(f"the object's friction times {factor:g}", {"randomization": Randomization((factor, factor))})


#: From the side and steeper than the first camera; 0.60 m away.
_SIDE = replace(FRONT, eye=(0.25, -0.3, 0.5))

#: By name; the first is the one that the others differ from.
CONDITIONS: Mapping[str, Condition] = {
    "nominal": Condition("nothing but object, pose and sensor noise varies"),
    "hand_5": _hand(5, 5),
    "hand_10": _hand(10, 10),
    "friction_0.5": _friction(0.5),
    "friction_0.3": _friction(0.3),
    "mass_2": Condition("the object's mass times 2", {"randomization": Randomization(mass=(2.0, 2.0))}),
    "camera": Condition("another camera, from the side and from higher", {"cameras": CamerasConfig(cameras=(_SIDE,))}),
    "calibration": Condition(
        "the camera is up to 10 mm and 1.1 degrees away from where it is said to be",
        {"randomization": Randomization(camera_position=0.01, camera_rotation=0.02)},
    ),
    "shake": Condition(
        "a success is shaken with 2 g along and about six axes", {"trial": TrialConfig(shake=ShakeConfig())}
    ),
}
