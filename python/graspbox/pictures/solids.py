"""The colours that all pictures share, and a box's edges."""

import numpy as np

from graspbox.pictures.view import Floats
from graspbox.planning import Box

OBJECT = "#d8b78c"
SUCCESS, FAILURE, UNTRIED = "#009e73", "#d55e00", "#444444"
#: Okabe and Ito's colours, told apart by everybody; the first stand out from `OBJECT`.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d1f")

#: Corners of a box (see `Box.corners`) that its edges join.
_EDGES = ((0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7))


def place(points: Floats, pose: Floats) -> Floats:
    """Move points (..., 3) by a pose (4, 4)."""
    moved: Floats = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def box_edges(box: Box) -> Floats:
    """Take the edges of a box as segments (12, 2, 3)."""
    edges: Floats = box.corners()[np.array(_EDGES)]
    return edges
