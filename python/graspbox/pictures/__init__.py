"""Pictures (extra ``cli``), one function each; ``save_*`` write a file whose ending names the format.

| function | picture |
|---|---|
| `save_plan`       | boxes on an object, and its best poses |
| `save_sweep`      | boxes for each pair of the planner's thresholds (the study's figures 2.3 and 2.4) |
| `save_kindness`   | how a failed and a firm grasp move in the hand over time (its figures 3.17 and 3.18) |
| `save_stages`     | a grasp in stages: open, closed, lifting, held |
| `save_episode`    | an episode of ``graspbox/Grasp-v0`` that the scripted expert solves, and what is observed in it |
| `save_comparison` | its table 3.1 beside ours, as bars; `Comparison` is the table |

Objects and hands are drawn by the renderer that makes the environments' images; lines and text are matplotlib's.
"""

from graspbox.pictures.episodes import save_episode
from graspbox.pictures.plans import AREA_GAINS, MIN_VOLUMES, save_plan, save_sweep
from graspbox.pictures.study import COLUMNS, CUP_GUESS, TABLE_3_1, Comparison, StudyRow, save_comparison, study_objects
from graspbox.pictures.trials import Trial, firm_and_failed, save_kindness, save_stages
from graspbox.pictures.view import Camera, PosedHand, Solid, View

__all__ = [
    "AREA_GAINS",
    "COLUMNS",
    "CUP_GUESS",
    "MIN_VOLUMES",
    "TABLE_3_1",
    "Camera",
    "Comparison",
    "PosedHand",
    "Solid",
    "StudyRow",
    "Trial",
    "View",
    "firm_and_failed",
    "save_comparison",
    "save_episode",
    "save_kindness",
    "save_plan",
    "save_stages",
    "save_sweep",
    "study_objects",
]
