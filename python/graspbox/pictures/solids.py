"""Colours shared by all pictures, and coloured meshes of boxes and cylinders."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.meshes import Mesh, mesh_from_arrays
from graspbox.planning import Box

Floats = NDArray[np.float64]

OBJECT = "#d8b78c"
#: One colour per object in pictures of several objects.
OBJECTS = ("#e2b77d", "#8fb3d9", "#a9c08f", "#d9a3a0", "#b9a9d4", "#c9c4b8")
#: Of objects beside the one that a picture is about, and of walls.
NEIGHBOUR, WALL = "#c6c9ce", "#b9bcc2"
SUCCESS, FAILURE, NOT_SIMULATED = "#009e73", "#d55e00", "#444444"
#: Okabe and Ito's colours, which colour-blind readers can distinguish; the first ones contrast most with `OBJECT`.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d1f")

#: Indices of the corners of a box (see `Box.corners`) at its edges, and at its sides, counter-clockwise from outside.
_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))
_SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
#: Number of facets of a cylinder.
_COLUMNS = 32


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh of one colour (in matplotlib's notation) at a pose."""

    mesh: Mesh
    color: str
    world_from_mesh: Floats = field(default_factory=lambda: np.eye(4))
    casts_shadow: bool = True


def place(points: Floats, pose: Floats) -> Floats:
    """Transform points (..., 3) by a pose (4, 4)."""
    moved: Floats = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def place_box(box: Box, pose: Floats) -> Box:
    """Transform a box by a pose (4, 4)."""
    return Box(place(box.center, pose), pose[:3, :3] @ box.axes, box.half_extents)


def colored_boxes(boxes: Iterable[Box]) -> list[tuple[Box, str]]:
    """Assign a colour to each box, sorted by volume, largest first."""
    ordered = sorted(boxes, key=lambda box: -box.volume)
    return [(box, COLORS[index % len(COLORS)]) for index, box in enumerate(ordered)]


def box_edges(box: Box) -> Floats:
    """Return the edges of a box as segments (12, 2, 3)."""
    edges: Floats = box.corners()[np.array(_EDGES)]
    return edges


def box_mesh(box: Box, name: str = "box") -> Mesh:
    """Make a mesh of a box with right-handed axes."""
    faces = [triangle for a, b, c, d in _SIDES for triangle in ((a, b, c), (a, c, d))]
    return mesh_from_arrays(box.corners(), np.array(faces), name=name)


def wall_solids(poses: Floats, half_extents: Floats) -> list[Solid]:
    """Make a box of each wall of a bin, from poses (w, 4, 4) and half extents (w, 3)."""
    boxes = [Box(pose[:3, 3], pose[:3, :3], half) for pose, half in zip(poses, half_extents, strict=True)]
    return [Solid(box_mesh(box, "wall"), WALL) for box in boxes]


def cylinder_mesh(center: ArrayLike, axis: ArrayLike, radius: float, half_length: float) -> Mesh:
    """Make a mesh of a cylinder about the direction `axis` (3,); metres."""
    along, side, up = frame_along(axis)
    turns = 2 * np.pi * np.arange(_COLUMNS) / _COLUMNS
    ring = radius * (np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * up)
    middle = np.asarray(center, dtype=np.float64)
    ends = [middle - half_length * along, middle + half_length * along]
    vertices = np.concatenate([ring + ends[0], ring + ends[1], ends])
    n, faces = _COLUMNS, []
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return mesh_from_arrays(vertices, np.array(faces), name="cylinder")


def frame_along(axis: ArrayLike) -> Floats:
    """Extend a direction (3,) to a right-handed frame; rows (3, 3), the direction first."""
    along = np.asarray(axis, dtype=np.float64)
    along = along / np.linalg.norm(along)
    side = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    side /= np.linalg.norm(side)
    return np.array([along, side, np.cross(along, side)])
