"""From a mesh to simulated grasps.

>>> import graspbox
>>> mesh = graspbox.object_sets.load("procedural:mug:3")[0].load()
>>> tree = graspbox.decompose(mesh, max_boxes=4)
>>> len(tree)
4

Importing the package registers its Gymnasium environments. Repairs and cache use are logged to the logger ``graspbox``.
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspbox import errors, object_sets
from graspbox._core import __version__
from graspbox.configs import (
    CameraConfig,
    CamerasConfig,
    CleanConfig,
    DecomposeConfig,
    FrictionConfig,
    LoadConfig,
    NewtonConfig,
    PhysicsConfig,
    PictureConfig,
    PlanConfig,
    PoseConfig,
    Randomization,
    RapierConfig,
    ShakeConfig,
    SuccessCriterion,
    TrialConfig,
)
from graspbox.envs import register
from graspbox.errors import GraspboxError
from graspbox.layouts import Arrangement, arrange
from graspbox.meshes import Mesh, load_mesh, mesh_from_arrays
from graspbox.planning import Box, BoxTree, Grasp, Plan, decompose, plan
from graspbox.simulation import Hand, Outcome, Outcomes, Scene, Trace, load_hand, simulate
from graspbox.views import ViewPlan, Views, depth_millimetres, occupancy, views
from graspbox.voxels import Voxels, load_binvox, save_binvox, voxelize

__all__ = [
    "Arrangement",
    "Box",
    "BoxTree",
    "CameraConfig",
    "CamerasConfig",
    "CleanConfig",
    "DecomposeConfig",
    "FrictionConfig",
    "Grasp",
    "GraspboxError",
    "Hand",
    "LoadConfig",
    "Mesh",
    "NewtonConfig",
    "Outcome",
    "Outcomes",
    "PhysicsConfig",
    "PictureConfig",
    "Plan",
    "PlanConfig",
    "PoseConfig",
    "Randomization",
    "RapierConfig",
    "Scene",
    "ShakeConfig",
    "SuccessCriterion",
    "Trace",
    "TrialConfig",
    "ViewPlan",
    "Views",
    "Voxels",
    "__version__",
    "arrange",
    "dataset",
    "decompose",
    "depth_millimetres",
    "errors",
    "evaluation",
    "load_binvox",
    "load_hand",
    "load_mesh",
    "mesh_from_arrays",
    "object_sets",
    "occupancy",
    "plan",
    "policies",
    "save_binvox",
    "simulate",
    "viewer",
    "views",
    "voxelize",
]

if TYPE_CHECKING:
    from graspbox import dataset, evaluation, policies, viewer

logging.getLogger(__name__).addHandler(logging.NullHandler())
register()


def __getattr__(name: str) -> Any:
    """Import subpackages that ``import graspbox`` does not need on first access."""
    if name in ("dataset", "evaluation", "policies", "viewer"):
        return import_module(f"graspbox.{name}")
    raise AttributeError(f"module 'graspbox' has no attribute {name!r}")
