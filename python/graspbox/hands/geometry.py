"""The geometry of a hand: its collision boxes, how far it reaches, its symmetries."""

from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand

__all__ = ["corners_of", "reach_of", "symmetries_of"]

#: Steps of closing at which the reach is measured.
_CLOSING_STEPS = 21
#: Greatest distance of a reflected hand from itself, metres.
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
        about z. The identity is not among them. Boxes around the collision shapes are compared.
    """
    positions = [hand.closed(preshape, share) for preshape in hand.preshapes.values() for share in (0.0, 0.5, 1.0)]
    corners = [corners_of(hand, each) for each in positions]

    def same(signs: tuple[float, float, float]) -> bool:
        distances = (np.linalg.norm(each[:, None] - each[None] * signs, axis=2).min(axis=1).max() for each in corners)
        return all(distance < _SAME for distance in distances)

    return tuple(filter(same, ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))))
