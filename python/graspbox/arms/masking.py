"""Which measured points show the arm itself, or the hand that it carries."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._core import Arm
from graspbox.arms.loading import ArmLike, load_arm
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand

__all__ = ["checked_joints", "on_arm"]

#: How far beyond its limits a joint may be measured, rad or m.
_BEYOND = 0.1


def checked_joints(arm: Arm, joints: ArrayLike) -> NDArray[np.float64]:
    """Check measured positions of an arm's joints, (k,).

    Raises
    ------
    ConfigError
        If there are not k finite numbers, or one is beyond the limits of its joint by more than 0.1 rad or m.
    """
    positions, names = floats(joints, "joints"), arm.joints
    if positions.shape != (len(names),):
        raise ConfigError(
            f"joints have shape {positions.shape}; the arm {arm.name} has {len(names)}: {', '.join(names)}"
        )
    for name, position, (low, high) in zip(names, positions.tolist(), arm.joint_limits.tolist(), strict=True):
        if not low - _BEYOND <= position <= high + _BEYOND:
            raise ConfigError(
                f"joints put {name} of the arm {arm.name} at {position:g}, beyond its range {low:.4g} .. {high:.4g}; "
                f"pass radians (metres for sliding joints), in the order {', '.join(names)}"
            )
    return positions


def on_arm(
    arm: ArmLike,
    joints: ArrayLike,
    points: ArrayLike,
    world_from_base: ArrayLike,
    *,
    hand: HandLike | None = None,
    mount: ArrayLike | None = None,
    distance: float | NDArray[np.float64] = 0.02,
    num_threads: int | None = None,
) -> NDArray[np.bool_]:
    """Return which points (n,) are on an arm or the hand that it carries: they are no obstacles.

    The fingers are not measured: a hand is taken in all its preshapes, open, closed and between.

    Parameters
    ----------
    arm : str, Arm or pair of paths
        See `load_arm`.
    joints : (k,) array_like
        Positions of its joints when the points were measured, rad or m.
    points : (n, 3) array_like
        Measured points, world frame, metres.
    world_from_base : (4, 4) array_like
        Pose of the arm's base.
    hand, mount
        The hand and the pose of its base on the flange, as of `reachable`; without a hand none is carried.
    distance : float or (n,) array
        How far from the shapes of a link a point may be, metres: at their edges up to 1.7 times as far.
    num_threads : int, optional
        By default one per core.

    Raises
    ------
    ConfigError
        For arrays of another shape, positions beyond the limits, and a pose that is not rigid.
    """
    loaded, cloud = load_arm(arm), floats(points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ConfigError(f"points have the shape {cloud.shape}; give (n, 3)")
    margins = floats(distance, "distance")
    if margins.shape not in ((), (len(cloud),)) or (margins < 0).any():
        raise ConfigError(f"distance has shape {margins.shape}; give one of 0 m or more, or one per point")
    return loaded.on_arm(
        cloud,
        np.ascontiguousarray(np.broadcast_to(margins, len(cloud))),
        checked_joints(loaded, joints),
        floats(world_from_base, "world_from_base"),
        None if hand is None else load_hand(hand),
        None if mount is None else floats(mount, "mount"),
        num_threads,
    )
