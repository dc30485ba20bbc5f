"""Arms: loaded by name or from their two files, which poses of a hand they reach, and which points show them.

>>> import numpy as np
>>> from graspbox import arms
>>> arm = arms.load_arm("fr3")
>>> arm.flange_poses(arm.home[None]).round(3)[0, :3, 3].tolist()
[0.307, 0.0, 0.59]
"""

from graspbox._core import Arm
from graspbox.arms.loading import ArmLike, load_arm
from graspbox.arms.mapping import BasePlace, ReachMap, reach_map
from graspbox.arms.masking import on_arm
from graspbox.arms.reaching import Reach, Reason, inverse, reachable

__all__ = [
    "Arm",
    "ArmLike",
    "BasePlace",
    "Reach",
    "ReachMap",
    "Reason",
    "inverse",
    "load_arm",
    "on_arm",
    "reach_map",
    "reachable",
]
