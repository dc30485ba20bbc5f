"""Rigid bodies of a hand, by their rows in `HandDescription.moving` (-1: the palm), and inertias that joints move."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.hand_tools.boxes import gaps
from graspbox.hands import Hand
from graspbox.hands.description import describe
from graspbox.hands.geometry import box_corners

__all__ = ["HandBodies", "inertia_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Step of numeric derivatives, rad or m.
_STEP = 1e-5
#: Bodies of a linkage stay within this distance of each other wherever it is, metres.
_PINNED = 4e-3


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
    limits : (c, 2) float64
        Limits of the independent joints, rad or m.
    chain_of : (j,) int64
        The chain of each rigid body.
    """

    def __init__(self, hand: Hand) -> None:
        self.hand, self.described = hand, describe(hand)
        owners = list(zip(self.described.links, self.described.carriers, strict=True))
        self.shape_names = [shape.name for link, _ in owners for shape in link.shapes]
        self.pads = np.array([shape.pad for link, _ in owners for shape in link.shapes], dtype=bool)
        self.bodies = np.array([body for link, body in owners for _ in link.shapes], dtype=np.int64)

        self.limits = np.asarray(hand.joint_limits, dtype=np.float64).reshape(-1, 2)
        self.chain_of: Ints = hand.joint_frames(np.ascontiguousarray(self.limits[:, 0]))[1]

    def boxes(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return poses (n, 4, 4), grasp frame, and half extents (n, 3) of the boxes around the shapes."""
        poses, halves, _, _ = self.hand.shapes(np.ascontiguousarray(positions))
        return poses, halves

    def corners(self, positions: Floats, body: int) -> Floats:
        """Return the corners (m, 3) of the boxes of a rigid body, grasp frame."""
        poses, halves = self.boxes(positions)
        return box_corners(poses[self.bodies == body], halves[self.bodies == body])

    def pair_gaps(self, positions: Floats, pairs: Ints) -> Floats:
        """Return the distances (n,) of pairs (n, 2) of shapes, metres; negative where they overlap."""
        poses, halves = self.boxes(positions)
        first, second = pairs.T
        return gaps(poses[first], halves[first], poses[second], halves[second])

    def is_pinned(self, chain: int, other: int) -> bool:
        """Whether a chain is the bar of a linkage: it moves with another one, and its end is beside it at all times."""
        leaders = self._leaders(chain)
        shaped = [body for body in np.flatnonzero(self.chain_of == chain) if (self.bodies == body).any()]
        if len(leaders) != 1 or self._leaders(other) != leaders or not shaped:
            return False
        chains = np.append(self.chain_of, -1)[self.bodies]
        pairs = np.argwhere((self.bodies == shaped[-1])[:, None] & (chains == other)[None])
        looks = (self.limits[:, 0], self.limits.mean(axis=1), self.limits[:, 1])
        return len(pairs) > 0 and all(self.pair_gaps(look, pairs).min() < _PINNED for look in looks)

    def _leaders(self, chain: int) -> set[int]:
        """Return the independent joints that a chain's joints are or follow, by their links."""
        links = [link for link, own in zip(self.described.moving, self.chain_of, strict=True) if own == chain]
        return {link.index if link.mimic is None else link.mimic[0] for link in links}


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
