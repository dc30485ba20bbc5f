"""Replay of trials in an independent simulator, MuJoCo.

The replay and the core share the hand's description, the object's convex parts and the definition of success, but no
code of a simulation. The model is that of exported scenes (``graspbox.tools.scene_export.mjcf``). It needs ``mujoco``
(extra ``dev``). A test compares the descriptions with MuJoCo's own reader of URDFs.

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
| `exported`    | trials replayed in exported scenes, only from their files |
| `command`, `export_command`, ... | the commands; `validation.options` has their common parts |

``python tests/validate.py mujoco --trials 200 --seed 0 [--json]``
"""

# ruff: noqa: E402 (the modules of this package import mujoco)
from graspbox._common.imports import imported

imported("mujoco", "validation.mujoco needs the package mujoco, from the extra 'dev'", "dev")

from graspbox.hands.description import HandDescription
from graspbox.tools.scene_export.contents import object_data
from validation.mujoco.compare import DEFAULT_OBJECTS, PLANNER_OBJECTS, compare, describe
from validation.mujoco.replay import Outcome, TrialTimes, replay
from validation.mujoco.report import Report, Row
from validation.mujoco.robust import Perturbation, RobustReport, RobustRow, compare_robust
from validation.mujoco.sampling import perturbed, random_pose, sample_trials
from validation.mujoco.scene import Numerics, ObjectData, Scene, build

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
    "replay",
    "sample_trials",
]
