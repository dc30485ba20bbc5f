"""The geometry of a hand: collision boxes, reach, symmetries."""

from collections.abc import Iterable
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.hands.description import describe

__all__ = ["asymmetries_of", "box_corners", "combined_mass", "corners_of", "reach_of", "symmetries_of"]

Array = NDArray[np.float64]

#: Corners of a box of half extents 1, (8, 3).
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
#: Steps of closing at which the reach is measured.
_CLOSING_STEPS = 21
#: Greatest distance of a reflected hand from itself in a symmetry, metres.
_SAME = 5e-4


def box_corners(poses: Array, half_extents: Array) -> Array:
    """Return the corners (8 n, 3) of n boxes, from their poses (n, 4, 4) and half extents (n, 3), metres."""
    turned = (_CORNERS * half_extents[:, None]) @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    return np.asarray(turned.reshape(-1, 3))


def corners_of(hand: Hand, positions: Array, parts: Literal["all", "palm", "fingers"] = "all") -> Array:
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
    return box_corners(poses[wanted], half[wanted])


def combined_mass(bodies: Iterable[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass, centre of mass (3,) and inertia about it (3, 3) of bodies together, each given by the same."""
    masses, centers, inertias = map(np.array, zip(*bodies, strict=True))
    mass = float(masses.sum())
    center = masses @ centers / mass if mass > 0.0 else centers.mean(axis=0)
    away = centers - center
    squares = np.einsum("ni,ni->n", away, away)[:, None, None] * np.eye(3)
    steiner = squares - np.einsum("ni,nj->nij", away, away)
    return mass, center, inertias.sum(axis=0) + np.einsum("n,nij->ij", masses, steiner)


def reach_of(hand: Hand, preshape: float) -> float:
    """Return the greatest extent of the fingers from the palm while they close, metres along the grasp frame's z."""
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
    """Return the distance by which each reflection of `symmetries_of` moves the collision shapes, metres; 0: symmetry.

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


def _marks(hand: Hand, positions: Array) -> Array:
    """Return points (n, 5) that fix the collision shapes: x, y, z, the radius, and the number of the kind."""
    poses, half, _, _ = hand.shapes(positions)
    kinds = [shape.kind for link in describe(hand).links for shape in link.shapes]
    points = {"box": _CORNERS, "cylinder": np.array([[0, 0, -1.0], [0, 0, 1.0]]), "sphere": np.zeros((1, 3))}
    rows = []
    for pose, sides, kind in zip(poses, half, kinds, strict=True):
        radius = 0.0 if kind == "box" else sides[0]
        for point in points[kind]:
            rows.append((*(pose[:3, :3] @ (point * sides) + pose[:3, 3]), radius, float(list(points).index(kind))))
    return np.array(rows)
