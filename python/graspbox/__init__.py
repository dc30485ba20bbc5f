"""From a mesh to simulated grasps.

>>> import graspbox
>>> mesh = graspbox.object_sets.load("procedural:mug:3")[0].load()
>>> tree = graspbox.decompose(mesh, max_boxes=4)
>>> len(tree)
4

Its Gymnasium environments are registered once this package and `gymnasium` are imported. Its names are imported on
first access, so that ``graspbox --help`` answers at once. Repairs and cache use are logged to the logger ``graspbox``.
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

from graspbox._common.imports import after_import

if TYPE_CHECKING:
    from graspbox import arms, errors, evaluation, object_sets, policies
    from graspbox._core import __version__
    from graspbox.configs import (
        CameraConfig,
        CamerasConfig,
        CleanConfig,
        DecomposeConfig,
        FrictionConfig,
        ImplicitConfig,
        LoadConfig,
        PathConfig,
        PhysicsConfig,
        PictureConfig,
        PlanConfig,
        PoseConfig,
        Randomization,
        RapierConfig,
        ReachConfig,
        ShakeConfig,
        SuccessCriterion,
        TrialConfig,
    )
    from graspbox.errors import GraspboxError
    from graspbox.meshes import Mesh, load_mesh, mesh_from_arrays
    from graspbox.meshes.views import ViewPlan, Views, depth_millimetres, occupancy, views
    from graspbox.meshes.voxels import Voxels, load_binvox, save_binvox, voxelize
    from graspbox.planning import Box, BoxTree, Grasp, Plan, decompose, plan
    from graspbox.simulation import Hand, Outcome, Outcomes, Scene, Trace, load_hand, simulate
    from graspbox.simulation.layouts import Arrangement, arrange

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
    "ImplicitConfig",
    "LoadConfig",
    "Mesh",
    "Outcome",
    "Outcomes",
    "PathConfig",
    "PhysicsConfig",
    "PictureConfig",
    "Plan",
    "PlanConfig",
    "PoseConfig",
    "Randomization",
    "RapierConfig",
    "ReachConfig",
    "Scene",
    "ShakeConfig",
    "SuccessCriterion",
    "Trace",
    "TrialConfig",
    "ViewPlan",
    "Views",
    "Voxels",
    "__version__",
    "arms",
    "arrange",
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
    "views",
    "voxelize",
]

#: Packages that an attribute of this one imports.
_PACKAGES = (
    "arms",
    "configs",
    "envs",
    "errors",
    "evaluation",
    "hands",
    "meshes",
    "object_sets",
    "perception",
    "planning",
    "policies",
    "simulation",
)
#: Modules, and the names of this package that they define.
_NAMES = {
    "graspbox._core": "__version__",
    "graspbox.configs": (
        "CameraConfig CamerasConfig CleanConfig DecomposeConfig FrictionConfig ImplicitConfig LoadConfig PathConfig "
        "PhysicsConfig PictureConfig PlanConfig PoseConfig Randomization RapierConfig ReachConfig ShakeConfig "
        "SuccessCriterion TrialConfig"
    ),
    "graspbox.errors": "GraspboxError",
    "graspbox.meshes": "Mesh load_mesh mesh_from_arrays",
    "graspbox.meshes.views": "ViewPlan Views depth_millimetres occupancy views",
    "graspbox.meshes.voxels": "Voxels load_binvox save_binvox voxelize",
    "graspbox.planning": "Box BoxTree Grasp Plan decompose plan",
    "graspbox.simulation": "Hand Outcome Outcomes Scene Trace load_hand simulate",
    "graspbox.simulation.layouts": "Arrangement arrange",
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import a name or a package on first access."""
    if name in _PACKAGES:
        return import_module(f"graspbox.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'graspbox' has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    """List the names that are imported on first access, too."""
    return sorted({*globals(), *__all__, *_PACKAGES})


def _register_environments() -> None:
    import_module("graspbox.envs")


def _enter_workers() -> None:
    import_module("graspbox.sb3.workers")


logging.getLogger(__name__).addHandler(logging.NullHandler())
after_import("gymnasium", _register_environments)
after_import("stable_baselines3", _enter_workers)
