"""From one depth image to grasps, without a mesh or a true pose.

`graspbox.perception.finder.grasps` lists the stages: a `DepthView` is levelled, its object is cropped (`Crops`) and
completed, and a `Finder` proposes grasps, which are scored (`FoundGrasp`). Nothing here needs torch; the networks are
in `graspbox.learn.models`.

>>> import graspbox, numpy as np
>>> from graspbox import perception
>>> mesh = graspbox.object_sets.load("procedural:can:0")[0].load()
>>> seen = graspbox.views(mesh, count=2)
>>> depth = perception.add_depth_noise(seen.depth, seen.intrinsics, seed=0)
>>> crops = perception.crop(depth, seen.intrinsics, seen.world_from_camera)
>>> crops.channels.shape, crops.found.tolist()
((2, 3, 48, 48, 48), [True, True])
>>> view = perception.DepthView(depth[0], seen.intrinsics, seen.world_from_camera[0])
>>> perception.PlannedFinder(graspbox.load_hand("reflex")).find(view).world_from_hand.shape
(4, 4)
"""

from graspbox.perception._finders import HeadFinder, PlannedFinder
from graspbox.perception.configs import (
    CropConfig,
    DepthNoise,
    FinderConfig,
    HandGridConfig,
    ProposalConfig,
    RehearsalConfig,
)
from graspbox.perception.crops import CHANNELS, Crops, add_depth_noise, crop, solid_occupancy
from graspbox.perception.depth_views import DepthView
from graspbox.perception.finder import Finder, FoundGrasp, GraspFinder, Query
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid, Proposals
from graspbox.perception.hand_settings import HandSettings, settings_of
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.real import Workspace

__all__ = [
    "CHANNELS",
    "HAND_CHANNELS",
    "CropConfig",
    "Crops",
    "DepthNoise",
    "DepthView",
    "Finder",
    "FinderConfig",
    "FoundGrasp",
    "GraspFinder",
    "HandGrid",
    "HandGridConfig",
    "HandSettings",
    "HeadFinder",
    "PlannedFinder",
    "PoseNoise",
    "ProposalConfig",
    "Proposals",
    "Query",
    "RehearsalConfig",
    "Workspace",
    "add_depth_noise",
    "crop",
    "settings_of",
    "solid_occupancy",
]
