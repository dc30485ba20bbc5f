"""Arms: loaded from files, what they reach, by which paths, and which points show them.

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
from graspbox.arms.paths import plan_path
from graspbox.arms.reaching import Reach, Reason, inverse, reachable
from graspbox.arms.trajectories import Sample, Trajectory

__all__ = [
    "Arm",
    "ArmLike",
    "BasePlace",
    "Reach",
    "ReachMap",
    "Reason",
    "Sample",
    "Trajectory",
    "inverse",
    "load_arm",
    "on_arm",
    "plan_path",
    "reach_map",
    "reachable",
]
