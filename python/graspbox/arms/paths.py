"""Paths of a whole arm: to a grasp, up with the object, on to a place, and away from it."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, floats, natural
from graspbox._common.imports import imported
from graspbox.arms.loading import ArmLike, load_arm
from graspbox.arms.timing import NEED, Limits, TimedPiece, limits_of, tell, timed
from graspbox.arms.trajectories import Trajectory
from graspbox.configs import PathConfig
from graspbox.errors import ConfigError, PathError
from graspbox.hands import HandLike, cache_folder, load_hand
from graspbox.meshes import MeshLike, Surroundings, as_mesh, placed

__all__ = ["plan_path"]

#: Phases after which the hand acts, and what it does.
_ACTS = {"approach": "close", "lower": "open"}


def plan_path(
    arm: ArmLike,
    hand: HandLike,
    world_from_hand: ArrayLike,
    preshape: ArrayLike,
    world_from_base: ArrayLike,
    *,
    target: tuple[MeshLike, ArrayLike] | None = None,
    place: ArrayLike | None = None,
    objects: list[tuple[MeshLike, ArrayLike]] | None = None,
    neighbours: Surroundings | None = None,
    points: ArrayLike | None = None,
    mount: ArrayLike | None = None,
    start: ArrayLike | None = None,
    config: PathConfig = PathConfig(),  # noqa: B008 (frozen)
    speed: float = 1.0,
    hand_time: float = 1.0,
    max_duration: float | None = None,
    hz: float = 100.0,
    num_threads: int | None = None,
) -> Trajectory:
    """Plan a path to the first grasp that has one, and time it: from the start to the approach, to the grasp, up.

    With a `place` it goes on: to above the place, down, and back from the object. The table is the plane z = 0. Arm,
    hand and object keep `ReachConfig.clearance` from everything, and half of it between the postures that are looked
    at; the reference page on arms says what is checked in which phase. The same arguments give the same trajectory.

    Parameters
    ----------
    arm : str, Arm or pair of paths
        See `load_arm`.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    world_from_hand : (4, 4) or (n, 4, 4) array_like
        Grasps, the preferred one first: poses of the hand's grasp frame, metres.
    preshape : float or (n,) array_like
        See `graspbox.Hand.preshape_limits`.
    world_from_base : (4, 4) array_like
        Pose of the arm's base.
    target : (Mesh, (4, 4) array_like), optional
        The object that is grasped, with its pose. Without it the hand counts as empty on the lift.
    place : (4, 4) array_like, optional
        Pose in which the target is released.
    objects : list of (Mesh, (4, 4) array_like), optional
        Other objects with their poses.
    neighbours : Surroundings, optional
        Further objects and walls, such as a `graspbox.Arrangement`.
    points : (m, 3) array_like, optional
        Measured points, metres: what is seen. None may be on the arm itself. Those on the target are left out.
    mount : (4, 4) array_like, optional
        Pose of the hand's base link in the frame of the flange; by default as the files of arm and hand state it.
    start : (k,) array_like, optional
        Positions of the joints at the start, rad or m; by default home.
    config : PathConfig
        Settings of the path.
    speed : float
        Share of the arm's speeds that is used, above 0 to 1; accelerations by its square.
    hand_time : float
        Time that the arm waits for the hand to close, and to open, seconds.
    max_duration : float, optional
        Longest duration, seconds; a grasp whose path takes longer has none.
    hz : float
        Samples per second; `Trajectory.resampled` changes it.
    num_threads : int, optional
        Number of threads; results do not depend on it.

    Raises
    ------
    PathError
        If no grasp has a path: the attributes say where and why.
    ArmError
        If the hand is heavier than the payload, or mounted inside a link.
    ConfigError
        If the base is under the table, a pose is not rigid, or a setting is out of range.
    MissingExtraError
        Without the package ruckig, of the extra ``arm``.
    """
    imported("ruckig", NEED, "arm")
    loaded, hand = load_arm(arm), load_hand(hand)
    poses, preshapes = _grasps(world_from_hand, preshape)
    _check_numbers(speed=speed, hand_time=hand_time, max_duration=max_duration)
    if place is not None and target is None:
        raise ConfigError("place is the pose of the target when it is released; pass target=(mesh, pose) too")
    settings = config_dict(config, PathConfig)
    natural(config.seed, "seed", 64)
    limits = limits_of(loaded, speed)
    given = (
        hand,
        loaded.home if start is None else floats(start, "start"),
        limits.acceleration,
        floats(world_from_base, "world_from_base"),
        None if mount is None else floats(mount, "mount"),
        *_around(points, objects, neighbours),
        None if target is None else (as_mesh(target[0]), floats(target[1], "the pose of the target")),
        None if place is None else floats(place, "place"),
        settings,
        cache_folder(),
        num_threads,
    )

    def plan(first: int) -> dict[str, Any]:
        return _core.arm_path(loaded, poses[first:], preshapes[first:], *given)

    grasp, pieces = _first(plan, len(poses), limits, hand_time, max_duration)
    tell(loaded, limits)
    facts = {"joints": tuple(loaded.joints), "arm": loaded.name, "hand_name": hand.name, "grasp": grasp}
    return Trajectory.of(pieces, hz, **facts, preshape=float(preshapes[grasp]), assumptions=limits.assumed)


def _around(
    points: ArrayLike | None, objects: list[tuple[MeshLike, ArrayLike]] | None, neighbours: Surroundings | None
) -> tuple[Any, Any, Any]:
    """Return points (m, 3), objects with their poses, and walls."""
    cloud = floats(np.zeros((0, 3)) if points is None else points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ConfigError(f"points have the shape {cloud.shape}; give (m, 3)")
    around, walls = placed(neighbours)
    given = [(as_mesh(mesh), floats(pose, "the pose of an object")) for mesh, pose in objects or []]
    return cloud, [*given, *around], walls


def _grasps(world_from_hand: ArrayLike, preshape: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return poses (n, 4, 4) and preshapes (n,)."""
    poses, preshapes = floats(world_from_hand, "world_from_hand"), floats(preshape, "preshape")
    if poses.ndim == 2:
        poses = poses[None]
    if preshapes.ndim == 0:
        preshapes = np.full(len(poses), float(preshapes))
    if not len(poses):
        raise ConfigError("world_from_hand has no pose; give (4, 4) or (n, 4, 4)")
    return poses, preshapes


def _check_numbers(*, speed: float, hand_time: float, max_duration: float | None) -> None:
    if not 0 < speed <= 1:
        raise ConfigError(f"speed is {speed}; it must be above 0 and at most 1")
    if not 0 <= hand_time <= 3600:
        raise ConfigError(f"hand_time is {hand_time}; it must be 0 to 3600 s")
    if max_duration is not None and not max_duration > 0:
        raise ConfigError(f"max_duration is {max_duration}; it must be positive")


def _first(
    plan: Callable[[int], dict[str, Any]], count: int, limits: Limits, hand_time: float, max_duration: float | None
) -> tuple[int, list[TimedPiece]]:
    """Find the first of `count` grasps that has a path in time; returns its index and the path.

    `plan` finds the first one with a path among those from an index on.
    """
    begin, failures, late = 0, [], []
    while begin < count:
        found = plan(begin)
        failures += found["failures"]
        if found["grasp"] < 0:
            break
        begin += found["grasp"] + 1
        try:
            pieces = _timed(found["pieces"], limits, hand_time)
        except PathError as error:
            failures.append((error.phase, error.reason, str(error)))
            continue
        duration = sum(piece.duration for piece in pieces)
        if max_duration is None or duration <= max_duration:
            return begin - 1, pieces
        late.append(duration)
        failures.append(("", "too_long", f"the path takes {duration:.2f} s"))
    if late:
        which = "the path" if len(late) == 1 else f"the fastest of {len(late)} paths"
        message = f"{which} takes {min(late):.2f} s, longer than max_duration ({max_duration:g} s)"
        raise PathError(message, reason="too_long", failures=tuple(sentence for _, _, sentence in failures))
    raise _failure(failures)


def _failure(failures: list[tuple[str, str, str]]) -> PathError:
    """Return the error for grasps without a path: it names the most frequent reasons."""
    sentences = tuple(sentence for _, _, sentence in failures)
    (phase, reason, first), *_ = Counter(failures).most_common(1)[0]
    if len(failures) == 1:
        return PathError(f"no path to the grasp: {first}", phase, reason, sentences)
    counted = ", ".join(f"{text} ({count})" for text, count in Counter(sentences).most_common(3))
    return PathError(f"no path to any of {len(failures)} grasps: {counted}", phase, reason, sentences)


def _timed(pieces: list[tuple[str, Any, Any]], limits: Limits, hand_time: float) -> list[TimedPiece]:
    """Time the pieces of a path, and let the hand act between them."""
    result: list[TimedPiece] = []
    for phase, postures, lengths in pieces:
        result += timed(phase, postures, lengths, limits)
        if phase in _ACTS:
            coefficients = np.zeros((1, 4, postures.shape[1]))
            coefficients[0, 0] = postures[-1]
            still = np.zeros((1, 4))
            result.append(
                TimedPiece(_ACTS[phase], np.array([0.0, 1.0]), coefficients, np.zeros(1), still, float(hand_time))
            )
    return result
