"""Which poses an arm reaches, by which postures, and why it does not reach the others."""

from collections import Counter
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import config_dict, floats
from graspbox._common.by_value import ByValue
from graspbox._core import Arm
from graspbox.arms.loading import ArmLike, load_arm
from graspbox.configs import ReachConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, cache_folder, load_hand
from graspbox.meshes import MeshLike, Surroundings, as_mesh, placed

__all__ = ["Reach", "Reason", "inverse", "reachable"]


class Reason(IntEnum):
    """Why a pose is or is not reached."""

    #: By a posture that touches nothing.
    REACHED = 0
    #: Farther than the lengths of the arm allow in any posture: certain.
    TOO_FAR = 1
    #: In the nearest posture that was found, a joint is at its limit, and the flange would come nearer beyond it.
    AT_LIMIT = 2
    #: In all postures that were found, the arm touches itself, the hand, the table, a measured point, or an object.
    TOUCHES_ARM = 3
    TOUCHES_HAND = 4
    TOUCHES_TABLE = 5
    TOUCHES_POINTS = 6
    TOUCHES_OBJECT = 7
    #: With fewer than six joints: the position is met, but the rotation not within `ReachConfig.max_angle`.
    TURNED = 8
    #: No posture was found, for none of these reasons.
    NOT_FOUND = 9


@dataclass(frozen=True, eq=False, repr=False)
class Reach(ByValue):
    """What an arm reaches of n poses; k is the number of its joints.

    A slice, a mask or an array of indices gives the answers of these rows.

    Attributes
    ----------
    reached : (n,) bool
        Whether a posture within the limits was found that touches nothing.
    joints : (n, k) float64
        The preferred posture, rad or m, NaN where the pose is not reached: near home, away from limits and
        singularities.
    solutions : (n, s, k) float64
        All postures that were found, at most `ReachConfig.solutions`, the preferred one first; NaN where there are
        fewer. Of the endless postures of seven joints they are samples.
    reason : (n,) int64
        A `Reason`.
    why : tuple of str
        The reason as a sentence, such as ``link6 touches the table``; empty where the pose is reached.
    room : (n,) float64
        Distance of the preferred posture from the nearest limit, as a share of half the range of that joint: 0 at a
        limit, 1 with all joints in the middle.
    singular : (n,) float64
        Least singular value of its Jacobian (m and rad): 0 at a singularity.
    angle : (n,) float64
        Angle that remains to the rotation of the pose, rad: 0 but for rounding with six joints or more.
    arm : str
        Name of the arm.
    """

    solutions: NDArray[np.float64]
    reason: NDArray[np.int64]
    why: tuple[str, ...]
    room: NDArray[np.float64]
    singular: NDArray[np.float64]
    angle: NDArray[np.float64]
    arm: str = ""

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Return whether each pose is reached, (n,)."""
        return np.asarray(self.reason == Reason.REACHED)

    @property
    def joints(self) -> NDArray[np.float64]:
        """Return the preferred postures, (n, k)."""
        return self.solutions[:, 0]

    def __len__(self) -> int:
        return len(self.reason)

    def __repr__(self) -> str:
        return f"Reach({self.arm!r}, poses={len(self)}, reached={int(self.reached.sum())})"

    def __getitem__(self, index: slice | NDArray[Any] | list[int]) -> Self:
        kept = np.arange(len(self))[index]
        rows = ("solutions", "reason", "room", "singular", "angle")
        why = tuple(self.why[row] for row in kept.tolist())
        return replace(self, why=why, **{name: getattr(self, name)[kept] for name in rows})

    def first(self) -> NDArray[np.int64]:
        """Return the order of the rows, (n,), with the reached ones first; within both, it stays."""
        return np.asarray(np.argsort(~self.reached, kind="stable"))

    def counts(self) -> dict[str, int]:
        """Count the reasons, as sentences, the most frequent first."""
        return dict(Counter(why or "reached" for why in self.why).most_common())

    def to_json(self) -> list[dict[str, Any]]:
        """Return an entry of plain values per row."""
        return [
            {
                "reached": bool(self.reached[row]),
                "joints": self.joints[row].tolist() if self.reached[row] else None,
                "why": self.why[row],
                "room": float(self.room[row]) if self.reached[row] else None,
                "singular": float(self.singular[row]) if self.reached[row] else None,
                "angle": float(self.angle[row]) if self.reached[row] else None,
            }
            for row in range(len(self))
        ]


def _answers(arm: Arm, arrays: dict[str, Any]) -> Reach:
    names = ("solutions", "reason", "room", "singular", "angle")
    return Reach(why=tuple(arrays["why"]), arm=arm.name, **{name: arrays[name] for name in names})


def inverse(
    arm: ArmLike,
    base_from_flange: ArrayLike,
    *,
    config: ReachConfig = ReachConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> Reach:
    """Find postures for poses of the flange, whatever they touch: inverse kinematics within the limits.

    Parameters
    ----------
    arm : str, Arm or pair of paths
        See `load_arm`.
    base_from_flange : (n, 4, 4) array_like
        Poses, metres.
    config : ReachConfig
        Settings; distances to obstacles have no effect.
    num_threads : int, optional
        Number of threads; results do not depend on it.

    Raises
    ------
    ConfigError
        For a pose that is not rigid, or a setting out of range.
    """
    loaded, poses = load_arm(arm), floats(base_from_flange, "base_from_flange")
    return _answers(loaded, loaded.inverse(poses, config_dict(config, ReachConfig), num_threads))


def reachable(
    arm: ArmLike,
    hand: HandLike,
    world_from_hand: ArrayLike,
    preshape: ArrayLike,
    world_from_base: ArrayLike,
    *,
    mount: ArrayLike | None = None,
    points: ArrayLike | None = None,
    objects: list[tuple[MeshLike, ArrayLike]] | None = None,
    neighbours: Surroundings | None = None,
    config: ReachConfig = ReachConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> Reach:
    """Find which poses of an open hand an arm reaches, over the table z = 0.

    The links must not touch each other, the hand, the table, points and objects. Their shapes enclose the real links.
    What the hand itself touches is not asked: planner and policies answer that.

    Parameters
    ----------
    arm : str, Arm or pair of paths
        See `load_arm`.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    world_from_hand : (n, 4, 4) array_like
        Poses of the hand's grasp frame, metres.
    preshape : (n,) array_like
        See `graspbox.Hand.preshape_limits`.
    world_from_base : (4, 4) array_like
        Pose of the arm's base.
    mount : (4, 4) array_like, optional
        Pose of the hand's base link in the frame of the flange; by default as the files of arm and hand state it
        (`Arm.flange_from_base_of`).
    points : (m, 3) array_like, optional
        Measured points, metres: what is seen, without those of the arm itself (`on_arm`).
    objects : list of (Mesh, (4, 4) array_like), optional
        Objects with their poses.
    neighbours : Surroundings, optional
        Further objects and walls, such as a `graspbox.Arrangement`.
    config : ReachConfig
        Settings.
    num_threads : int, optional
        Number of threads; results do not depend on it.

    Raises
    ------
    ArmError
        If the hand is heavier than the payload, or mounted inside a link.
    ConfigError
        If the base is under the table, a pose is not rigid, or a setting is out of range.
    """
    loaded, hand = load_arm(arm), load_hand(hand)
    around, walls = placed(neighbours)
    given = [(as_mesh(mesh), floats(pose, "the pose of an object")) for mesh, pose in objects or []]
    cloud = floats(np.zeros((0, 3)) if points is None else points, "points")
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ConfigError(f"points have the shape {cloud.shape}; give (m, 3)")
    arrays = loaded.reach(
        floats(world_from_hand, "world_from_hand"),
        floats(preshape, "preshape"),
        hand,
        floats(world_from_base, "world_from_base"),
        None if mount is None else floats(mount, "mount"),
        cloud,
        [*given, *around],
        walls,
        config_dict(config, ReachConfig),
        cache_folder(),
        num_threads,
    )
    return _answers(loaded, arrays)
