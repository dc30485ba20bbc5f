"""Candidate poses of a scene from every source except the planner, for any hand.

All geometry is in the world frame: the table is the plane z = 0. Hand frames have z along the approach and x along the
closing direction of opposing fingers.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox._common.rotations import poses_from, rotation_about
from graspbox._core import Hand
from graspbox.simulation import Scene

__all__ = ["HandGeometry", "Poses", "Surface", "deviated", "jittered", "low", "on_normals", "randomly"]

Floats = NDArray[np.float64]

#: Number of surface points from which poses are made.
_POINTS = 1000
#: Number of directions, over half a turn, among which the least extent is searched.
_DIRECTIONS = 18
#: Extents use the points within this distance of the approach axis, metres: half an open hand.
_NEIGHBOURHOOD = 0.07
#: Greatest deviation of the closing direction from the least extent, radians.
_ROLL_ERROR = 0.2
#: Normals that point down steeper than this (sine) are left out: the hand would pass through the table.
_STEEPEST = -0.5
#: Greatest tilt of a pose from above, radians.
_LEAN = 0.15
#: Height of the lowest point of the hand in low poses, metres.
_LOW = (0.001, 0.002)
#: The step of closing at which this height applies, as a share of the way from the step of the lowest reach to the
#: last: least, most frequent and greatest. On seven flat YCB objects, success was highest at about a third.
_LATE_STEP = (0.0, 0.35, 0.8)
#: Depth of a surface point in the hand, as shares of the depth at which the hand closes.
_DEPTH = (0.2, 1.1)
#: Standard deviations of jitter along and about each axis, metres and radians.
_JITTER = (0.008, 0.14)


class Poses(NamedTuple):
    """Poses of a hand: `world_from_hand` (n, 4, 4), metres, and preshapes (n,)."""

    world_from_hand: Floats
    preshape: Floats

    @classmethod
    def joined(cls, parts: Iterable["Poses"]) -> "Poses":
        """Concatenate poses."""
        poses = [cls(np.zeros((0, 4, 4)), np.zeros(0)), *parts]
        return cls(np.concatenate([p.world_from_hand for p in poses]), np.concatenate([p.preshape for p in poses]))

    def chosen(self, rows: NDArray[Any] | slice) -> "Poses":
        """Select rows."""
        return Poses(self.world_from_hand[rows], self.preshape[rows])


@dataclass(frozen=True)
class HandGeometry:
    """Hand geometry for candidates; the first axis of every array is over its p preshapes.

    `centers` (p, 3) are the points where the hand closes, and `corners` (p, s, k, 3) those of the collision shapes of
    the open hand and of s - 1 steps of closing; hand frame, metres.
    """

    preshapes: Floats
    centers: Floats
    corners: Floats

    @classmethod
    def of(cls, hand: Hand, steps: int = 17) -> "HandGeometry":
        """Measure a hand."""
        preshapes = np.array(list(hand.preshapes.values()))
        centers = np.stack([hand.closing_center(preshape) for preshape in preshapes])
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij")).reshape(3, 8).T

        def corners(preshape: float, share: float) -> Floats:
            at = hand.open(preshape) if share == 0.0 else hand.closed(preshape, share)
            frames, half, _, _ = hand.shapes(at)
            turned: Floats = np.einsum("nij,nkj->nki", frames[:, :3, :3], half[:, None] * signs)
            return turned + frames[:, None, :3, 3]

        shares = np.linspace(0.0, 1.0, steps)
        every = [[corners(preshape, share).reshape(-1, 3) for share in shares] for preshape in preshapes]
        return cls(preshapes, centers, np.array(every))


@dataclass(frozen=True)
class Surface:
    """Points (n, 3) and outward normals (n, 3) of the object's surface, world, metres."""

    points: Floats
    normals: Floats

    @classmethod
    def of(cls, scene: Scene, seed: int) -> "Surface":
        """Sample the surface of an object at rest."""
        points, normals = scene.mesh.sample(_POINTS, seed)
        rotation, translation = scene.world_from_object[:3, :3], scene.world_from_object[:3, 3]
        return cls(points @ rotation.T + translation, normals @ rotation.T)


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def _rotations(vectors: Floats) -> Floats:
    """Convert rotation vectors (n, 3), radians, to rotation matrices (n, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=1)
    axis = vectors / np.where(angle > 0.0, angle, 1.0)[:, None]
    return rotation_about(axis, angle)


def _least_extent(surface: Surface, point: Floats, approach: Floats) -> tuple[Floats, Floats]:
    """Find the closing directions (n, 3), across the approach, along which the surface near its axis is narrowest.

    Also returns the offsets (n,) along them from `point` to the middle between the two sides, metres.
    """
    # Two axes perpendicular to the approach and to each other.
    first = _unit(np.cross(approach, np.eye(3)[np.abs(approach).argmin(axis=1)]))
    second = np.cross(approach, first)
    offset = surface.points[None] - point[:, None]
    u, v = (np.einsum("nmj,nj->nm", offset, axis) for axis in (first, second))
    far = u**2 + v**2 > _NEIGHBOURHOOD**2
    turn = np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS)
    along = u[..., None] * np.cos(turn) + v[..., None] * np.sin(turn)
    high = np.where(far[..., None], -np.inf, along).max(axis=1)
    low = np.where(far[..., None], np.inf, along).min(axis=1)
    best = (high - low).argmin(axis=1)
    rows = np.arange(len(point))
    direction = first * np.cos(turn[best])[:, None] + second * np.sin(turn[best])[:, None]
    return direction, (high[rows, best] + low[rows, best]) / 2.0


def _frames(closing: Floats, approach: Floats) -> Floats:
    """Rotations (n, 3, 3) with the approach as z, and x as near as possible to `closing`."""
    x = _unit(closing - (closing * approach).sum(axis=1, keepdims=True) * approach)
    return np.stack([x, np.cross(approach, x), approach], axis=2)


def _closed_at(
    point: Floats, rotation: Floats, depth: tuple[float, float], hand: HandGeometry, rng: np.random.Generator
) -> Poses:
    """Put points (n, 3) between the fingers, at a share of the depth at which the hand closes, with any preshape."""
    which = rng.integers(len(hand.preshapes), size=len(point))
    center = hand.centers[which] * np.array([1.0, 1.0, 0.0])
    center[:, 2] = hand.centers[which, 2] * rng.uniform(*depth, len(point))
    origin = point - np.einsum("nij,nj->ni", rotation, center)
    return Poses(poses_from(origin, rotation), hand.preshapes[which])


def _closing(surface: Surface, point: Floats, approach: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Rotations (n, 3, 3) that close along the least extent, either way around, and middles (n, 3) between sides."""
    direction, middle = _least_extent(surface, point, approach)
    target = point + direction * middle[:, None]
    turned = _rotations(approach * rng.uniform(-_ROLL_ERROR, _ROLL_ERROR, len(point))[:, None])
    sign = rng.choice([-1.0, 1.0], len(point))[:, None]
    return _frames(np.einsum("nij,nj->ni", turned, direction * sign), approach), target


def on_normals(surface: Surface, hand: HandGeometry, count: int, rng: np.random.Generator) -> Poses:
    """Poses onto points of the surface, along the inward normal or straight down, closing along the least extent."""
    open_above = np.flatnonzero(surface.normals[:, 2] > _STEEPEST)
    allowed = open_above if len(open_above) else np.arange(len(surface.points))
    chosen = allowed[rng.integers(len(allowed), size=count)]
    point, normal = surface.points[chosen], surface.normals[chosen]
    down = rng.random(count) < 0.5
    approach = np.where(down[:, None], [0.0, 0.0, -1.0], -normal)
    rotation, target = _closing(surface, point, approach, rng)
    return _closed_at(target, rotation, _DEPTH, hand, rng)


def low(surface: Surface, hand: HandGeometry, count: int, rng: np.random.Generator) -> Poses:
    """Poses from above whose lowest point is 1 to 2 mm above the table at some step of closing.

    Fingers that swing in reach lowest half-way, and rise as they close further. A hand low enough for a later
    step presses them on the table earlier, and they slide along it to flat objects.
    """
    point = surface.points[rng.integers(len(surface.points), size=count)]
    lean = rng.uniform(-_LEAN, _LEAN, (count, 3)) * [1.0, 1.0, 0.0]
    approach = _rotations(lean) @ np.array([0.0, 0.0, -1.0])
    rotation, target = _closing(surface, point, approach, rng)
    which = rng.integers(len(hand.preshapes), size=count)
    lowest_step = hand.corners[..., 2].max(axis=2).argmax(axis=1)[which]
    late = rng.triangular(*_LATE_STEP, count) * (hand.corners.shape[1] - 1 - lowest_step)
    step = lowest_step + late.astype(np.int64)
    lowest = np.einsum("nj,nkj->nk", rotation[:, 2], hand.corners[which, step]).min(axis=1)
    origin = target - np.einsum("nij,nj->ni", rotation, hand.centers[which])
    origin[:, 2] = rng.uniform(*_LOW, count) - lowest
    return Poses(poses_from(origin, rotation), hand.preshapes[which])


def randomly(surface: Surface, hand: HandGeometry, count: int, rng: np.random.Generator) -> Poses:
    """Poses from any direction, with any roll, at points of the surface."""
    point = surface.points[rng.integers(len(surface.points), size=count)]
    rotation = _frames(*(_unit(rng.standard_normal((count, 3))) for _ in range(2)))
    return _closed_at(point, rotation, (0.0, 1.3), hand, rng)


def jittered(good: Poses, count: int, rng: np.random.Generator) -> Poses:
    """Poses near `good` ones; needs at least one."""
    chosen = good.chosen(rng.integers(len(good.preshape), size=count))
    moved = rng.standard_normal((count, 6)) * np.repeat(_JITTER, 3)
    return Poses(_moved(chosen.world_from_hand, moved), chosen.preshape)


def deviated(world_from_hand: Floats, position: float, rotation: float, rng: np.random.Generator) -> Floats:
    """Add uniform errors to poses (n, 4, 4), along and about each axis of the hand.

    The bounds are `position`, metres, and `rotation`, radians.
    """
    moved = rng.uniform(-1.0, 1.0, (len(world_from_hand), 6)) * np.repeat([position, rotation], 3)
    return _moved(world_from_hand, moved)


def _moved(world_from_hand: Floats, moved: Floats) -> Floats:
    """Move poses by translations and rotation vectors (n, 6) in their own frames."""
    return world_from_hand @ poses_from(moved[:, :3], _rotations(moved[:, 3:]))


#: Sources that need neither a plan nor successes, by name.
SOURCES: dict[str, Callable[[Surface, HandGeometry, int, np.random.Generator], Poses]] = {
    "normal": on_normals,
    "low": low,
    "random": randomly,
}
