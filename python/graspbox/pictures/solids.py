"""What is drawn, as triangles (n, 3, 3) in metres, and the colours that all pictures share."""

import numpy as np
from numpy.typing import NDArray

from graspbox.meshes import Mesh
from graspbox.pictures.view import Floats, Solid
from graspbox.planning import Box
from graspbox.simulation import Hand

OBJECT, TABLE, LINK, PAD = "#c9b79c", "#e9ecef", "#5b7ba6", "#2b3a52"
SUCCESS, FAILURE, UNTRIED = "#009e73", "#d55e00", "#555555"
#: Okabe and Ito's colours, told apart by everybody; the first stand out from `OBJECT`.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d1f")

#: Most faces that are drawn (a scanned YCB mesh has 16,384); of a larger mesh an even choice, which lets light through.
_MAX_FACES = 40_000
#: Corners of a box (see `Box.corners`) that its edges join.
_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))
#: Corners of the twelve triangles of a box.
_SIDES = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)


def mesh_triangles(mesh: Mesh, world_from_object: Floats | None = None) -> Floats:
    """Take a mesh as triangles, in its own frame or in the world's."""
    faces = mesh.faces
    chosen = faces[:: max(1, -(-len(faces) // _MAX_FACES))]
    vertices = mesh.vertices if world_from_object is None else place(mesh.vertices, world_from_object)
    triangles: Floats = vertices[chosen]
    return triangles


def place(points: Floats, pose: Floats) -> Floats:
    """Move points (..., 3) by a pose (4, 4)."""
    moved: Floats = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def box_triangles(box: Box) -> Floats:
    """Take the sides of a box as triangles (12, 3, 3)."""
    triangles: Floats = box.corners()[np.array(_SIDES)]
    return triangles


def box_edges(box: Box) -> Floats:
    """Take the edges of a box as segments (12, 2, 3)."""
    edges: Floats = box.corners()[np.array(_EDGES)]
    return edges


def hand_solids(hand: Hand, frame: Floats, preshape: float, fingers: Floats | None = None) -> list[Solid]:
    """Take a hand's collision shapes, as boxes: links and pads.

    Parameters
    ----------
    hand : Hand
        The hand.
    frame : (4, 4)
        Pose of the hand's grasp frame.
    preshape : float
        Radians.
    fingers : (f, 2), optional
        Proximal and distal angle of each finger, radians; all 0, the open hand, by default.
    """
    angles = np.zeros((hand.fingers, 2)) if fingers is None else fingers
    proximal, distal = np.ascontiguousarray(angles[:, 0]), np.ascontiguousarray(angles[:, 1])
    poses, halves, pads = hand.shapes(preshape, proximal, distal)
    boxes = [box_triangles(Box(p[:3, 3], p[:3, :3], half)) for p, half in zip(frame @ poses, halves, strict=True)]
    return [
        (np.concatenate([b for b, pad in zip(boxes, pads, strict=True) if pad == wanted]), color)
        for wanted, color in ((False, LINK), (True, PAD))
        if np.any(pads == wanted)
    ]


def table_triangles(center: NDArray[np.float64], half: float) -> Floats:
    """Take a square of the table's top around a point (x, y) as triangles (2, 3, 3), world frame."""
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    corners = np.column_stack([np.asarray(center)[:2] + signs * half, np.zeros(4)])
    triangles: Floats = corners[np.array([(0, 1, 2), (0, 2, 3)])]
    return triangles
