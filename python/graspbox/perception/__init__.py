"""From one depth image to grasps: no mesh, no true pose, nothing that a camera over a table does not see.

>>> import graspbox, numpy as np
>>> from graspbox import perception
>>> mesh = graspbox.object_sets.load("procedural:can:0")[0].load()
>>> seen = graspbox.views(mesh, count=2)
>>> depth = perception.add_depth_noise(seen.depth, seen.intrinsics, seed=0)
>>> crops = perception.crop(depth, seen.intrinsics, seen.world_from_camera)
>>> crops.channels.shape, crops.found.tolist()
((2, 3, 48, 48, 48), [True, True])

A decision goes one way: a `DepthView` is leveled, its object is cropped (`Crops`), and a `Finder` ranks grasps there
(`FoundGrasp`).

| module | purpose |
|---|---|
| `configs`, `hand_settings` | settings; those that follow from a hand |
| `depth_images` | depth images from files: their units, the camera's lens and pose, the table |
| `depth_views`, `leveling` | one image with its camera, whose height and tilt the visible table corrects |
| `crops` | noise of a depth camera; the crop around the object, and its voxels |
| `finder` | `Finder`, `FoundGrasp`, and `GraspFinder`, which scores proposals; `HeadFinder` and `PlannedFinder` rank otherwise |
| `reachability` | which grasps of an object the open hand reaches, beside other objects and obstacles |
| `shapes` | a mesh of a completed volume, and grasps tried on it in simulation |
| `hand_grids` | candidate grasps of an occupied volume, and the voxels around the hand at each |
| `anchors` | a grid of steep grasps, and poses between them |
| `cameras`, `perturbations`, `outputs` | poses of cameras; errors of hand poses; outputs of networks, checked |

>>> view = perception.DepthView(depth[0], seen.intrinsics, seen.world_from_camera[0])
>>> found = perception.PlannedFinder(graspbox.load_hand("reflex")).find(view)
>>> found.world_from_hand.shape
(4, 4)

The networks are in `graspbox.models`; nothing here needs torch.
"""  # noqa: E501 (a table)

from graspbox.perception._head_finder import HeadFinder
from graspbox.perception._planned_finder import PlannedFinder
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
from graspbox.perception.finder import Finder, FoundGrasp, GraspFinder
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid, Proposals
from graspbox.perception.hand_settings import HandSettings, settings_of
from graspbox.perception.perturbations import PoseNoise

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
    "RehearsalConfig",
    "add_depth_noise",
    "crop",
    "settings_of",
    "solid_occupancy",
]
