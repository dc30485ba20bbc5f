"""What a completed volume is good for, besides scoring: a mesh of it, and trials of grasps with it.

| module | purpose |
|---|---|
| `surface` | the surface of a volume |
| `rehearsal` | grasps tried in simulation on a completed shape, before the robot moves |
"""

from graspbox.perception.shapes.rehearsal import Rehearsal, rehearsed_score, rehearsed_success
from graspbox.perception.shapes.surface import surface_mesh, surface_of

__all__ = ["Rehearsal", "rehearsed_score", "rehearsed_success", "surface_mesh", "surface_of"]
