"""An independent judge: trials of the core, replayed in MuJoCo.

It shares the hand's two files, the object's convex parts and the definition of success with the core, and no code. It
needs ``mujoco`` (extra ``dev``).

| module | what it does |
|---|---|
| `description` | reads a hand from the text of its URDF and its ``hand.toml`` |
| `scene`       | hand, object, table and friction as an MJCF model |
| `replay`      | one trial: close, lift, hold, judge |
| `compare`     | many trials in both engines: equal labels, differences, speed |

``python -m graspbox.mujoco_judge --trials 200 --seed 0 [--json]``
"""

from graspbox.errors import MissingExtraError

try:
    import mujoco as _mujoco  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "mujoco":
        raise
    raise MissingExtraError(
        "the MuJoCo judge needs the package mujoco, from the extra 'dev': pip install 'graspbox[dev]'"
    ) from None

from graspbox.mujoco_judge.compare import DEFAULT_OBJECTS, Report, Row, compare, object_data, random_pose, reflex
from graspbox.mujoco_judge.description import HandDescription, read_hand
from graspbox.mujoco_judge.replay import Outcome, TrialTimes, replay
from graspbox.mujoco_judge.scene import Numerics, ObjectData, Scene, build, mjcf

__all__ = [
    "DEFAULT_OBJECTS",
    "HandDescription",
    "Numerics",
    "ObjectData",
    "Outcome",
    "Report",
    "Row",
    "Scene",
    "TrialTimes",
    "build",
    "compare",
    "mjcf",
    "object_data",
    "random_pose",
    "read_hand",
    "reflex",
    "replay",
]
