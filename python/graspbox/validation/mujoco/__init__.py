"""Replay of trials in an independent simulator, MuJoCo.

The replay and the core share the hand's two files, the object's convex parts and the definition of success, but no
code. The model is that of exported scenes (`graspbox.scene_export`: ``description`` reads the hand, ``mjcf`` makes the
model). It needs ``mujoco`` (extra ``dev``).

| module | contents |
|---|---|
| `scene`       | the compiled model of hand, object, table and friction |
| `drive`       | actuators and soft stops between MuJoCo's steps |
| `replay`      | one trial: close, lift, hold, label |
| `sampling`    | poses: random, from the planner, perturbed |
| `compare`     | many trials in both engines: equal labels, differences, speed |
| `report`      | results of the comparison |
| `robust`      | success of perturbed copies of grasps in both engines |
| `heaps`       | attempts among several objects and walls |
| `exported`    | trials replayed in exported scenes, from their files alone |
| `command`, `export_command`, `robust_command` | the commands ``mujoco`` and ``planner``, ``export`` and ``robust`` |

``python -m graspbox.validation mujoco --trials 200 --seed 0 [--json]``
"""

# ruff: noqa: E402 (the modules of this package import mujoco)
from graspbox._common.extras import imported

imported("mujoco", "graspbox.validation.mujoco needs the package mujoco, from the extra 'dev'", "dev")

from graspbox.scene_export.contents import object_data
from graspbox.scene_export.description import HandDescription, read_hand
from graspbox.validation.mujoco.compare import DEFAULT_OBJECTS, PLANNER_OBJECTS, compare, describe
from graspbox.validation.mujoco.replay import Outcome, TrialTimes, replay
from graspbox.validation.mujoco.report import Report, Row
from graspbox.validation.mujoco.robust import Perturbation, RobustReport, RobustRow, compare_robust
from graspbox.validation.mujoco.sampling import perturbed, random_pose, sample_trials
from graspbox.validation.mujoco.scene import Numerics, ObjectData, Scene, build

__all__ = [
    "DEFAULT_OBJECTS",
    "PLANNER_OBJECTS",
    "HandDescription",
    "Numerics",
    "ObjectData",
    "Outcome",
    "Perturbation",
    "Report",
    "RobustReport",
    "RobustRow",
    "Row",
    "Scene",
    "TrialTimes",
    "build",
    "compare",
    "compare_robust",
    "describe",
    "object_data",
    "perturbed",
    "random_pose",
    "read_hand",
    "replay",
    "sample_trials",
]
