"""Pictures (extra ``cli``), one function each.

| function | picture |
|---|---|
| `save_plan`     | an object's boxes, its best grasp poses, and a trial or the open hand; neighbours are grey |
| `save_gallery`  | the same for several objects, one column per object |
| `save_sweep`    | boxes for each pair of the planner's thresholds (figures 2.3 and 2.4 of the reference study) |
| `save_kindness` | relative speed of hand and object in a failed and a firm grasp (its figures 3.17 and 3.18) |
| `save_stages`   | stages of grasps of one object or in clutter: open, closed, lifting, held |
| `save_trial`    | the same as a video |
| `save_arrangements` | several objects at rest: packed, in a pile, in a bin |
| `save_grasp_image` | a depth image with the grasps that a policy detects in it, and the best one in 3D |
| `save_hand_frames` | hands with their grasp frame and the frames of formats of grasps |
| `save_hand_motion` | a hand open, half closed and closed, with its pads and grasp frame |
| `save_path`     | a video of an arm on its path to a grasp |
| `save_episode`  | an episode of ``graspbox/Grasp-v0`` solved by the scripted expert, with images observed in it |
| `save_video`    | a video of pictures with captions |
| `save_rates`    | success and secure holds of policies, with confidence intervals |
| `save_reach_map` | share of typical grasps that an arm reaches, by where the thing stands |
| `save_reliability` | observed success rate over the probability that a policy predicted |

Paths are str or Path; their extension, one of `SUFFIXES`, or of `VIDEO_SUFFIXES` for videos, sets the format. Paths are
checked before any work, and files are written atomically. The choice of matplotlib's backend has no effect, because
nothing here uses pyplot.

The renderer of the environments renders objects and hands; matplotlib adds lines and text.
"""

import contextlib
import os
import sys

from graspbox._common.imports import imported


def _import_matplotlib() -> None:
    """Import matplotlib even if ``MPLBACKEND`` names an unknown backend, with which its import fails."""
    if sys.modules.get("matplotlib") is not None:
        return
    chosen = os.environ.pop("MPLBACKEND", None)
    try:
        matplotlib = imported("matplotlib", "graspbox.pictures needs matplotlib, from the extra 'cli'", "cli")
    finally:
        if chosen is not None:
            os.environ["MPLBACKEND"] = chosen
    if chosen:
        # Keep a valid choice for other code that uses pyplot.
        with contextlib.suppress(ValueError):
            matplotlib.rcParams["backend"] = chosen


_import_matplotlib()

# The imports below need matplotlib.
from graspbox.pictures.arrangements import save_arrangements  # noqa: E402
from graspbox.pictures.episodes import save_episode  # noqa: E402
from graspbox.pictures.evaluations import save_rates, save_reach_map, save_reliability  # noqa: E402
from graspbox.pictures.files import SUFFIXES, check_path  # noqa: E402
from graspbox.pictures.grasp_images import save_grasp_image  # noqa: E402
from graspbox.pictures.hand_frames import save_hand_frames  # noqa: E402
from graspbox.pictures.hands import PosedHand  # noqa: E402
from graspbox.pictures.motions import save_hand_motion, save_path  # noqa: E402
from graspbox.pictures.plans import GraspExample, save_gallery, save_plan  # noqa: E402
from graspbox.pictures.solids import Solid  # noqa: E402
from graspbox.pictures.sweeps import AREA_GAINS, MIN_VOLUMES, save_sweep  # noqa: E402
from graspbox.pictures.trials import Trial, firm_and_failed, save_kindness, save_stages, save_trial  # noqa: E402
from graspbox.pictures.videos import VIDEO_SUFFIXES, check_video, save_video  # noqa: E402
from graspbox.pictures.view import Camera, View  # noqa: E402

__all__ = [
    "AREA_GAINS",
    "MIN_VOLUMES",
    "SUFFIXES",
    "VIDEO_SUFFIXES",
    "Camera",
    "GraspExample",
    "PosedHand",
    "Solid",
    "Trial",
    "View",
    "check_path",
    "check_video",
    "firm_and_failed",
    "save_arrangements",
    "save_episode",
    "save_gallery",
    "save_grasp_image",
    "save_hand_frames",
    "save_hand_motion",
    "save_kindness",
    "save_path",
    "save_plan",
    "save_rates",
    "save_reach_map",
    "save_reliability",
    "save_stages",
    "save_sweep",
    "save_trial",
    "save_video",
]
