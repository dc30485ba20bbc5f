"""Rigid bodies of a hand, by their rows in `HandDescription.moving` (-1: the palm), and inertias that joints move."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.hands import Hand
from graspbox.hands.description import describe
from graspbox.hands.geometry import box_corners

__all__ = ["HandBodies", "inertia_of"]

Floats = NDArray[np.float64]

#: Step of numeric derivatives, rad or m.
_STEP = 1e-5


class HandBodies:
    """A hand with its n collision shapes.

    Attributes
    ----------
    hand, described : Hand, HandDescription
        The hand, and its description.
    shape_names : list of str
        Names of the shapes.
    pads : (n,) bool
        Which shapes are pads.
    bodies : (n,) int64
        The rigid body of each shape.
    """

    def __init__(self, hand: Hand) -> None:
        self.hand, self.described = hand, describe(hand)
        owners = list(zip(self.described.links, self.described.carriers, strict=True))
        self.shape_names = [shape.name for link, _ in owners for shape in link.shapes]
        self.pads = np.array([shape.pad for link, _ in owners for shape in link.shapes], dtype=bool)
        self.bodies = np.array([body for link, body in owners for _ in link.shapes], dtype=np.int64)

    def boxes(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return poses (n, 4, 4), grasp frame, and half extents (n, 3) of the boxes around the shapes."""
        poses, halves, _, _ = self.hand.shapes(np.ascontiguousarray(positions))
        return poses, halves

    def corners(self, positions: Floats, body: int) -> Floats:
        """Return the corners (m, 3) of the boxes of a rigid body, grasp frame."""
        poses, halves = self.boxes(positions)
        return box_corners(poses[self.bodies == body], halves[self.bodies == body])


def inertia_of(hand: Hand, joint: int, positions: ArrayLike) -> float:
    """Return the inertia that an independent joint moves at `positions` (c,), kg m2 or kg, without armature."""
    values = np.asarray(positions, dtype=np.float64)
    step = np.zeros(len(values))
    step[joint] = _STEP
    before, after = hand.link_frames(values - step), hand.link_frames(values + step)
    total = 0.0
    for link, first, second in zip(describe(hand).links, before, after, strict=True):
        speed = ((second - first) @ np.append(link.center, 1.0))[:3] / (2 * _STEP)
        turn = (second[:3, :3] - first[:3, :3]) @ first[:3, :3].T / (2 * _STEP)
        rate: Floats = first[:3, :3].T @ np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        total += link.mass * float(speed @ speed) + float(rate @ link.inertia @ rate)
    return total
