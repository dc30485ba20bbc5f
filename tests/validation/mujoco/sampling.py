"""Poses for the comparison: random around an object, from the planner, and perturbed copies of a pose."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox._common.rotations import rotation_about
from graspbox.configs import TrialConfig
from graspbox.hands import corners_of, reach_of
from graspbox.hands.description import Array

#: Source of poses: random ones around the object, the planner's best, or a random choice of the planner's.
Source = Literal["random", "planner", "planner-any"]

#: Poses are sampled in rounds until enough are feasible; after this many rounds the object is left out.
_MAX_ROUNDS = 20
#: Clearance between table and base, m.
_BASE_GAP = 0.005
#: A short trial to find out whether a pose is feasible.
_CHECK = TrialConfig(close_time=0.1, lift_time=0.1, hold_time=0.5)


def random_preshape(random: np.random.Generator, hand: graspbox.Hand) -> float:
    """Sample a preshape: the greatest with probability 0.3, else uniformly from the lower 38 % of the range.

    The greatest preshape of the ReFlex is a pinch. Named preshapes are equally likely.
    """
    low, high = hand.preshape_limits
    if hand.preshape_unit == "1":
        return float(random.integers(round(high) + 1))
    return high if random.random() < 0.3 else random.uniform(low, low + 0.6 / (0.5 * np.pi) * (high - low))


def random_pose(random: np.random.Generator, points: Array, center: Array, hand: graspbox.Hand) -> tuple[Array, float]:
    """Sample a hand pose from above or from a side, and a preshape.

    From above, the palm has a small gap to the object, and a height above the table of at least 0.9 to 1.28 times the
    fingers' reach, since the fingers fold against a nearer table. From a side, the base is above the table.

    Parameters
    ----------
    points : (n, 3)
        Corners of the object's parts, world frame.
    center : (3,)
        Centre of mass, world frame.
    hand : Hand
        The hand; its preshapes and dimensions are used.

    Returns
    -------
    world_from_hand : (4, 4)
        The pose, metres.
    preshape : float
        See `random_preshape`.
    """
    preshape = random_preshape(random, hand)
    yaw = random.uniform(0.0, 2.0 * np.pi)
    side = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    gap = random.uniform(0.003, 0.02)
    pose = np.eye(4)
    if random.random() < 0.5:
        pose[:3, :3] = np.column_stack([side, np.cross([0.0, 0.0, -1.0], side), [0.0, 0.0, -1.0]])
        height = max(points[:, 2].max() + gap, random.uniform(0.9, 1.28) * reach_of(hand, preshape))
        pose[:3, 3] = [*(center[:2] + random.uniform(-0.015, 0.015, 2)), height]
    else:
        x = np.cross([0.0, 0.0, 1.0], side) if random.random() < 0.5 else np.array([0.0, 0.0, 1.0])
        x = x * random.choice([-1.0, 1.0])
        turn = np.column_stack([x, np.cross(side, x), side])
        below = -float((corners_of(hand, hand.open(preshape), "palm") @ turn[2]).min())
        pose[:3, :3] = turn
        pose[:3, 3] = center - side * (float(((center - points) @ side).max()) + gap)
        pose[2, 3] = max(center[2], below + _BASE_GAP) + random.uniform(-0.01, 0.03)
    return pose, preshape


def _feasible(scene: graspbox.Scene, poses: Array, preshapes: Array) -> NDArray[np.bool_]:
    outcomes = scene.simulate(poses, preshapes, config=_CHECK)
    return np.array([failure != "infeasible" for failure in outcomes.failure], dtype=bool)


def _random_trials(scene: graspbox.Scene, count: int, random: np.random.Generator) -> tuple[Array, Array] | None:
    rest, body = np.array(scene.world_from_object), scene.body
    points = np.concatenate(body.parts) @ rest[:3, :3].T + rest[:3, 3]
    center = rest[:3, :3] @ body.center_of_mass + rest[:3, 3]
    world_to_object = np.linalg.inv(rest)
    poses, preshapes = np.empty((0, 4, 4)), np.empty(0)
    for _ in range(_MAX_ROUNDS):
        sampled = [random_pose(random, points, center, scene.hand) for _ in range(count)]
        candidates: Array = np.asarray(world_to_object @ np.stack([pose for pose, _ in sampled]))
        angles = np.array([preshape for _, preshape in sampled])
        feasible = _feasible(scene, candidates, angles)
        poses = np.concatenate([poses, candidates[feasible]])
        preshapes = np.concatenate([preshapes, angles[feasible]])
        if len(poses) >= count:
            return poses[:count], preshapes[:count]
    return None


def _planner_trials(
    scene: graspbox.Scene, count: int, random: np.random.Generator, *, best: bool
) -> tuple[Array, Array] | None:
    seed = int(random.integers(2**32))
    plan = graspbox.plan(scene.mesh, hand=scene.hand, world_from_object=scene.world_from_object, seed=seed).best()
    order = np.arange(len(plan)) if best else random.permutation(len(plan))
    # The planner's filter and the trial's may differ slightly, so check the poses again.
    kept: list[int] = []
    for start in range(0, len(order), count):
        chunk = order[start : start + count]
        kept += chunk[_feasible(scene, plan.poses[chunk], plan.preshape[chunk])].tolist()
        if len(kept) >= count:
            return plan.poses[kept[:count]], plan.preshape[kept[:count]]
    return None


def sample_trials(
    scene: graspbox.Scene, count: int, random: np.random.Generator, source: Source = "random"
) -> tuple[Array, Array] | None:
    """Sample `count` poses that are feasible in the core.

    Returns
    -------
    tuple or None
        (count, 4, 4) ``object_from_hand`` and (count,) preshapes; None if there are fewer feasible poses.
    """
    if source == "random":
        return _random_trials(scene, count, random)
    return _planner_trials(scene, count, random, best=source == "planner")


def perturbed(pose: Array, count: int, shift: float, turn: float, random: np.random.Generator) -> Array:
    """Return copies of a pose, each translated and rotated in a random direction.

    Parameters
    ----------
    pose : (4, 4)
        ``object_from_hand``.
    count : int
        Number of copies.
    shift, turn : float
        Greatest distance (m) and angle (rad); both are sampled uniformly. The hand rotates about its grasp frame.
    random : Generator
        The random number generator.

    Returns
    -------
    (count, 4, 4) array
    """
    moved = np.repeat(pose[None], count, axis=0)
    for copy in moved:
        along, axis = random.normal(size=(2, 3))
        copy[:3, 3] += along / np.linalg.norm(along) * random.uniform(0.0, shift)
        copy[:3, :3] = copy[:3, :3] @ rotation_about(axis / np.linalg.norm(axis), random.uniform(0.0, turn))
    return moved
