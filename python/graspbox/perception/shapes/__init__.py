"""Uses of a completed volume besides scoring: a mesh of it, and trials of grasps with it."""

from graspbox.perception.shapes.rehearsal import Rehearsal, rehearsed_score, rehearsed_success
from graspbox.perception.shapes.surface import surface_mesh, surface_of

__all__ = ["Rehearsal", "rehearsed_score", "rehearsed_success", "surface_mesh", "surface_of"]
