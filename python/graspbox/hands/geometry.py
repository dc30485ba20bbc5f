"""The geometry of a hand: its collision boxes, how far it reaches, its symmetries."""

from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand

__all__ = ["asymmetries_of", "corners_of", "reach_of", "symmetries_of"]

#: Steps of closing at which the reach is measured.
_CLOSING_STEPS = 21
#: Greatest distance of a reflected hand from itself in a symmetry, metres.
_SAME = 5e-4


def corners_of(
    hand: Hand, positions: NDArray[np.float64], parts: Literal["all", "palm", "fingers"] = "all"
) -> NDArray[np.float64]:
    """Return the corners (n, 3) of the boxes around a hand's collision shapes, grasp frame, metres.

    Parameters
    ----------
    hand : Hand
        The hand.
    positions : (c,) float64
        Positions of its independent joints, rad or m.
    parts : {"all", "palm", "fingers"}
        Which shapes: those of the palm do not move.
    """
    poses, half, _, carriers = hand.shapes(positions)
    wanted = {"all": carriers >= -1, "palm": carriers < 0, "fingers": carriers >= 0}[parts]
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))[None] * half[wanted, None]
    turned = corners @ poses[wanted, :3, :3].transpose(0, 2, 1) + poses[wanted, None, :3, 3]
    return np.asarray(turned.reshape(-1, 3))


def reach_of(hand: Hand, preshape: float) -> float:
    """Return how far the fingers extend from the palm while they close, metres along the grasp frame's z."""
    shares = np.linspace(0.0, 1.0, _CLOSING_STEPS).tolist()
    return max(float(corners_of(hand, hand.closed(preshape, share))[:, 2].max()) for share in shares)


def symmetries_of(hand: Hand) -> tuple[tuple[float, float, float], ...]:
    """Find the reflections of the grasp frame that map the closing hand onto itself with every preshape.

    Returns
    -------
    tuple of tuple of float
        Signs of the axes: (1, -1, 1) for the mirror plane y = 0, (-1, 1, 1) for x = 0, (-1, -1, 1) for a half turn
        about z. The identity is not among them.
    """
    return tuple(signs for signs, distance in asymmetries_of(hand).items() if distance < _SAME)


def asymmetries_of(hand: Hand) -> dict[tuple[float, float, float], float]:
    """Return how far each reflection of `symmetries_of` moves the collision shapes, metres; 0 for a symmetry.

    Corners of boxes, the ends of the axes of cylinders, the centres of spheres, and radii are compared: a cylinder
    may be turned about its axis.
    """
    positions = [hand.closed(preshape, share) for preshape in hand.preshapes.values() for share in (0.0, 0.5, 1.0)]
    marks = [_marks(hand, each) for each in positions]

    def moved(signs: tuple[float, float, float]) -> float:
        reflection = (*signs, 1.0, 1.0)
        return max(
            float(np.linalg.norm(each[:, None] - each[None] * reflection, axis=2).min(axis=1).max()) for each in marks
        )

    return {signs: moved(signs) for signs in ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))}


def _marks(hand: Hand, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (n, 5) that fix the collision shapes: x, y, z, the radius, and the number of the kind."""
    poses, half, _, _ = hand.shapes(positions)
    corners: list[tuple[float, ...]] = list(product((-1.0, 1.0), repeat=3))
    ends: list[tuple[float, ...]] = [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
    points: dict[str, list[tuple[float, ...]]] = {"cuboid": corners, "cylinder": ends, "sphere": [(0.0, 0.0, 0.0)]}
    rows = []
    for pose, sides, kind in zip(poses, half, hand.shape_kinds, strict=True):
        radius = 0.0 if kind == "cuboid" else sides[0]
        for point in points[kind]:
            place = pose[:3, :3] @ (np.array(point) * sides) + pose[:3, 3]
            rows.append((*place, radius, float(list(points).index(kind))))
    return np.array(rows)
