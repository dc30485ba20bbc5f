"""Classes of objects by shape and mass, for success rates per class."""

import numpy as np

from graspbox._core import Mesh
from graspbox.planning import decompose

__all__ = ["CLASSES", "object_classes"]

#: Definition of each class by name; an object may be in several, and is in ``box`` or ``round``.
CLASSES: dict[str, str] = {
    "flat": "the smallest side of its smallest box is under 25 mm, the next at least 30 mm",
    "thin": "the two smallest sides are under 30 mm",
    "heavy": "0.4 kg or more",
    "box": "three fifths of its surface or more look along the sides of its smallest box, within 15 degrees",
    "round": "all others",
}
_FLAT, _BROAD, _THIN, _HEAVY = 0.025, 0.03, 0.03, 0.4
_ALONG, _BOX_SHARE = np.cos(np.radians(15.0)), 0.6


def object_classes(mesh: Mesh) -> tuple[str, ...]:
    """Name the classes of an object, in the order of `CLASSES`; a flat or degenerate mesh has no box (`PlanError`)."""
    box = decompose(mesh, max_boxes=1)[0]
    least, middle, _ = np.sort(2.0 * box.half_extents)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    along = np.abs(normals @ box.axes).max(axis=1) >= _ALONG * areas
    boxy = areas[along].sum() >= _BOX_SHARE * areas.sum()
    member = {
        "flat": least < _FLAT and middle >= _BROAD,
        "thin": middle < _THIN,
        "heavy": mesh.mass >= _HEAVY,
        "box": boxy,
        "round": not boxy,
    }
    return tuple(name for name in CLASSES if member[name])
