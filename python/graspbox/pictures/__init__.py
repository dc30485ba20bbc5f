"""Pictures (extra ``cli``), one function each; ``save_*`` write a file whose ending names the format.

| function | picture |
|---|---|
| `save_plan`       | boxes on an object, and its best poses |
| `save_sweep`      | boxes for each pair of the planner's thresholds (the study's figures 2.3 and 2.4) |
| `save_kindness`   | how a failed and a firm grasp move in the hand over time (its figures 3.17 and 3.18) |
| `save_stages`     | a grasp in stages: open, closed, lifting, held |
| `save_episode`    | an episode of ``graspbox/Grasp-v0`` that the scripted expert solves, and what is observed in it |

Objects and hands are drawn by the renderer that makes the environments' images; lines and text are matplotlib's.
"""

from graspbox.pictures.episodes import save_episode
from graspbox.pictures.plans import AREA_GAINS, MIN_VOLUMES, save_plan, save_sweep
from graspbox.pictures.trials import Trial, firm_and_failed, save_kindness, save_stages
from graspbox.pictures.view import Camera, PosedHand, Solid, View

__all__ = [
    "AREA_GAINS",
    "MIN_VOLUMES",
    "Camera",
    "PosedHand",
    "Solid",
    "Trial",
    "View",
    "firm_and_failed",
    "save_episode",
    "save_kindness",
    "save_plan",
    "save_stages",
    "save_sweep",
]
