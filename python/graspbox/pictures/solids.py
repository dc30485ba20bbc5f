"""Coloured meshes at poses, and boxes of the planner as meshes and edges."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from graspbox._common.colors import COLORS, NEIGHBOUR, WALL
from graspbox.meshes import Mesh, Surroundings, mesh_from_arrays
from graspbox.meshes.shapes import BOX_EDGES, BOX_FACES, Floats, place
from graspbox.planning import Box


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh of one colour (in matplotlib's notation) at a pose."""

    mesh: Mesh
    color: str
    world_from_mesh: Floats = field(default_factory=lambda: np.eye(4))
    casts_shadow: bool = True

    @property
    def points(self) -> Floats:
        """Its vertices, (n, 3), world frame, metres."""
        return place(self.mesh.vertices, self.world_from_mesh)


def place_box(box: Box, pose: Floats) -> Box:
    """Transform a box by a pose (4, 4)."""
    return Box(place(box.center, pose), pose[:3, :3] @ box.axes, box.half_extents)


def colored_boxes(boxes: Iterable[Box]) -> list[tuple[Box, str]]:
    """Assign a colour to each box, sorted by volume, largest first."""
    ordered = sorted(boxes, key=lambda box: -box.volume)
    return [(box, COLORS[index % len(COLORS)]) for index, box in enumerate(ordered)]


def box_edges(box: Box) -> Floats:
    """Return the edges of a box as segments (12, 2, 3)."""
    edges: Floats = box.corners()[BOX_EDGES]
    return edges


def box_mesh(box: Box, name: str = "box") -> Mesh:
    """Make a mesh of a box with right-handed axes."""
    return mesh_from_arrays(box.corners(), BOX_FACES, name=name)


def solids_of(around: Surroundings, colors: Sequence[str] = (NEIGHBOUR,)) -> list[Solid]:
    """Return objects, with the colours in turn, and walls."""
    objects = [
        Solid(mesh, colors[index % len(colors)], pose)
        for index, (mesh, pose) in enumerate(zip(around.meshes, around.world_from_objects, strict=True))
    ]
    walls = zip(around.world_from_walls, around.wall_half_extents, strict=True)
    boxes = [Box(pose[:3, 3], pose[:3, :3], half) for pose, half in walls]
    return objects + [Solid(box_mesh(box, "wall"), WALL) for box in boxes]
