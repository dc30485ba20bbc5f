"""From one depth image to grasps: no mesh, no true pose, nothing that a camera over a table does not tell.

>>> import graspbox, numpy as np
>>> from graspbox import perception
>>> mesh = graspbox.object_sets.load("procedural:can:0")[0].load()
>>> seen = graspbox.views(mesh, count=2)
>>> depth = perception.add_depth_noise(seen.depth, seen.intrinsics, seed=0)
>>> crops = perception.crop(depth, seen.intrinsics, seen.world_from_camera)
>>> crops.channels.shape, crops.found.tolist()
((2, 3, 48, 48, 48), [True, True])

| module | what it does |
|---|---|
| `configs` | settings of all of it |
| `crops` | noise of a depth camera; the crop around the object, and its voxels |
| `leveling` | height and tilt of a camera, corrected by the table that it sees |
| `hand_grids` | candidate grasps of an occupied volume, and the voxels around the hand at each |
| `anchors` | a grid of steep grasps, and poses between them |
| `perturbations` | small errors of hand poses |

The networks are in modules of their own, which need torch (extra ``train``) and are not imported here: `scenes` renders
what they learn from, `completion` tells the object's occupancy from a crop, `scorer` tells how likely a grasp holds.
`export` writes them into the folder of a policy (`policy_folders`); `runtimes` runs them there with onnxruntime, and
`grasp_image` finds grasps in an image of one's own. `heads` predict a grasp alone. `stability` is what a hand feels of
its grasp, from which `stability_net` tells whether it will hold.
"""

from graspbox.perception.configs import CropConfig, DepthNoise, HandGridConfig, ProposalConfig
from graspbox.perception.crops import CHANNELS, Crops, add_depth_noise, crop, solid_occupancy
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid, Proposals
from graspbox.perception.perturbations import PoseNoise

__all__ = [
    "CHANNELS",
    "HAND_CHANNELS",
    "CropConfig",
    "Crops",
    "DepthNoise",
    "HandGrid",
    "HandGridConfig",
    "PoseNoise",
    "ProposalConfig",
    "Proposals",
    "add_depth_noise",
    "crop",
    "solid_occupancy",
]
