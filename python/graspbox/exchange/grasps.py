"""Grasps of one object and one hand, for export and import."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats, shown
from graspbox._common.by_value import ByValue
from graspbox._core import Hand, is_rigid
from graspbox.errors import ConfigError
from graspbox.exchange.conventions import Frame, frame_from_hand
from graspbox.hands import HandLike, load_hand

__all__ = ["MAX_GRASPS", "ExchangeGrasps"]

Array = NDArray[np.float64]

#: Most grasps of one object.
MAX_GRASPS = 1_000_000
#: Farthest that a hand or an object may be from the origin, metres; millimetres taken for metres are farther.
_FARTHEST = 10.0
#: Columns with a value per grasp, and the shape of one value; c is the number of independent joints.
_COLUMNS = ("poses", "preshape", "success", "confidence", "score", "world_from_object", "pregrasp", "grasp", "squeeze")


@dataclass(frozen=True, eq=False, repr=False)
class ExchangeGrasps(ByValue):
    """n grasps of one object, with the data of the object that other programs need.

    Make them with `of`, or with the functions of `graspbox.exchange`. A slice, a mask or an array of indices selects
    rows. NaN marks unknown values.

    Attributes
    ----------
    hand : Hand
        The hand.
    poses : (n, 4, 4) float64
        ``object_from_hand``: the hand's grasp frame in the object's frame, metres.
    preshape : (n,) float64
        See `graspbox.Hand.preshape_limits`.
    success : (n,) float64
        1 for a success in a trial, 0 for a failure.
    confidence : (n,) float64
        Predicted probability of success.
    score : (n,) float64
        Score of the planner; comparable only within one plan.
    world_from_object : (n, 4, 4) float64
        Pose of the object for each grasp; the table is the plane z = 0, metres.
    pregrasp, grasp, squeeze : (n, c) float64
        Positions of the independent joints (`graspbox.Hand.joints`) of the open hand, at the end of closing, and
        where the actuators would move the joints if the object were not in the way, rad or m.
    object_name : str
        Name of the object.
    mesh_file : str
        File of its mesh, as a path that the other program finds; empty if there is none.
    scale : float
        Metres per unit of the mesh file.
    mass : float
        Mass of the object, kg.
    mesh_sha256 : str
        Hash of its mesh (`graspbox.planning.plan_files.mesh_hash`); empty if it is not known.
    """

    hand: Hand
    poses: Array
    preshape: Array
    success: Array
    confidence: Array
    score: Array
    world_from_object: Array
    pregrasp: Array
    grasp: Array
    squeeze: Array
    object_name: str = ""
    mesh_file: str = ""
    scale: float = 1.0
    mass: float = float("nan")
    mesh_sha256: str = ""

    def __post_init__(self) -> None:
        count, joints = len(self.poses), len(self.hand.joints)
        shapes: dict[str, tuple[int, ...]] = {}
        shapes |= dict.fromkeys(("preshape", "success", "confidence", "score"), (count,))
        shapes |= dict.fromkeys(("poses", "world_from_object"), (count, 4, 4))
        shapes |= dict.fromkeys(("pregrasp", "grasp", "squeeze"), (count, joints))
        for name, shape in shapes.items():
            if (found := getattr(self, name).shape) != shape:
                raise ConfigError(f"{name} has shape {found}; give {shape}")
        if count > MAX_GRASPS:
            raise ConfigError(f"there are {count} grasps of {self.object_name!r}; give at most {MAX_GRASPS}")
        _check_poses(self.poses, "poses")
        known = ~np.isnan(self.world_from_object).any(axis=(1, 2))
        _check_poses(self.world_from_object[known], "world_from_object")
        self._check_numbers()

    def _check_numbers(self) -> None:
        low, high = self.hand.preshape_limits
        for name, least, most in (("preshape", low, high), ("success", 0.0, 1.0), ("confidence", 0.0, 1.0)):
            values = getattr(self, name)
            allowed = (values >= least - 1e-9) & (values <= most + 1e-9)
            if name != "preshape":
                allowed |= np.isnan(values)
            if not allowed.all():
                row = int(np.argmin(allowed))
                raise ConfigError(f"{name} of grasp {row} is {values[row]}; give a number from {least:g} to {most:g}")
        if not 0 < self.scale < float("inf"):
            raise ConfigError(f"scale is {shown(self.scale)}; give metres per unit of the mesh file, more than 0")
        if not (np.isnan(self.mass) or 0 < self.mass < float("inf")):
            raise ConfigError(f"mass is {shown(self.mass)}; give kilograms, more than 0, or NaN where it is unknown")

    @classmethod
    def of(
        cls,
        poses: ArrayLike,
        preshape: ArrayLike | None = None,
        *,
        hand: HandLike = "reflex",
        success: ArrayLike | None = None,
        confidence: ArrayLike | None = None,
        score: ArrayLike | None = None,
        world_from_object: ArrayLike | None = None,
        object_name: str = "",
        mesh_file: str | os.PathLike[str] = "",
        scale: float = 1.0,
        mass: float | None = None,
        mesh_sha256: str = "",
    ) -> Self:
        """Make grasps from arrays.

        Parameters
        ----------
        poses : (n, 4, 4) array_like
            ``object_from_hand``, metres.
        preshape : (n,) array_like, or float
            By default the only one that the hand has.
        hand : str, Hand or pair of paths
            See `graspbox.load_hand`.
        success, confidence, score : (n,) array_like, optional
            See the attributes; NaN, and by default all, are unknown.
        world_from_object : (4, 4) or (n, 4, 4) array_like, optional
            Resting pose of the object on the table, for all grasps or for each.
        object_name, mesh_file, scale, mass, mesh_sha256
            The object; see the attributes.

        Raises
        ------
        ConfigError
            If an array has another shape, a pose is not a rigid motion or more than 10 m away, or a number is out of
            range.
        """
        found, matrices = load_hand(hand), floats(poses, "poses")
        if matrices.ndim != 3:
            raise ConfigError(f"poses has shape {matrices.shape}; give (n, 4, 4)")
        count = len(matrices)
        given_shape = np.asarray(default_preshape(found) if preshape is None else floats(preshape, "preshape"))
        if given_shape.shape not in {(), (count,)}:
            raise ConfigError(f"preshape has shape {given_shape.shape}; give one number, or one for each of {count}")
        shapes = np.broadcast_to(given_shape, (count,))
        nothing = np.full((count, len(found.joints)), np.nan)
        world = np.full((4, 4), np.nan) if world_from_object is None else floats(world_from_object, "world_from_object")
        if world.shape not in {(4, 4), (count, 4, 4)}:
            raise ConfigError(f"world_from_object has shape {world.shape}; give (4, 4) or {(count, 4, 4)}")
        return cls(
            hand=found,
            poses=matrices.copy(),
            preshape=shapes.copy(),
            success=_column(success, "success", count),
            confidence=_column(confidence, "confidence", count),
            score=_column(score, "score", count),
            world_from_object=np.broadcast_to(world, (count, 4, 4)).copy(),
            pregrasp=_open_joints(found, shapes),
            grasp=nothing.copy(),
            squeeze=nothing.copy(),
            object_name=str(object_name),
            mesh_file=os.fspath(mesh_file),
            scale=float(scale),
            mass=float("nan") if mass is None else float(mass),
            mesh_sha256=mesh_sha256,
        )

    def __len__(self) -> int:
        return len(self.poses)

    def __repr__(self) -> str:
        known = int((~np.isnan(self.success)).sum())
        outcomes = f"{int(np.nansum(self.success))} of {known} succeeded" if known else "not simulated"
        return f"ExchangeGrasps({self.object_name!r}, {len(self)} grasps, {outcomes}, hand={self.hand.name!r})"

    def __getitem__(self, index: slice | NDArray[Any] | Sequence[int]) -> Self:
        if isinstance(index, int | np.integer):
            raise ConfigError(f"{index} selects one row; give a slice or a list of indices, such as [[{index}]]")
        kept = np.arange(len(self))[index]
        return replace(self, **{name: getattr(self, name)[kept] for name in _COLUMNS})

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Mask (n,) of the grasps whose joint positions at the end of closing are known."""
        return np.asarray(~np.isnan(self.grasp).any(axis=1))

    def object_from(self, frame: Frame) -> Array:
        """Return the poses (n, 4, 4) of the frame ``base`` or ``gripper`` of the hand in the object's frame, metres.

        `graspbox.exchange.conventions` defines the frames.
        """
        return np.asarray(self.poses @ np.linalg.inv(frame_from_hand(self.hand, frame)))

    def labeled(self, threshold: float) -> Self:
        """Count unknown successes as successes if their confidence is at least `threshold`, else as failures.

        Raises
        ------
        ConfigError
            If a grasp has neither outcome nor confidence, or `threshold` is not from 0 to 1.
        """
        if not 0 <= threshold <= 1:
            raise ConfigError(f"threshold is {shown(threshold)}; give a probability from 0 to 1")
        unknown = np.isnan(self.success)
        if np.isnan(self.confidence[unknown]).any():
            raise ConfigError(
                f"threshold needs the confidence of every grasp, and some of {self.object_name!r} have none; simulate "
                "them instead"
            )
        return replace(self, success=np.where(unknown, (self.confidence >= threshold).astype(np.float64), self.success))


def default_preshape(hand: Hand) -> float:
    """Return the only preshape of a hand.

    Raises
    ------
    ConfigError
        If the hand has several.
    """
    low, high = hand.preshape_limits
    if high > low:
        known = ", ".join(f"{value:.4g} ({name})" for name, value in hand.preshapes.items())
        raise ConfigError(f"preshape is missing, and {hand.name!r} has several; give one, for example {known}")
    return low


def _open_joints(hand: Hand, preshape: Array) -> Array:
    low, high = hand.preshape_limits
    values, rows = np.unique(np.clip(preshape, low, high), return_inverse=True)
    opened = [hand.open(float(value)) if np.isfinite(value) else np.full(len(hand.joints), np.nan) for value in values]
    return np.array(opened, dtype=np.float64).reshape(-1, len(hand.joints))[rows]


def _column(values: ArrayLike | None, name: str, count: int) -> Array:
    if values is None:
        return np.full(count, np.nan)
    found = floats(values, name)
    if found.shape != (count,):
        raise ConfigError(f"{name} has shape {found.shape}; give one number for each of {count} grasps")
    return found.copy()


def _check_poses(poses: Array, name: str) -> None:
    if not len(poses):
        return
    finite = np.isfinite(poses).all(axis=(1, 2))
    if not finite.all():
        raise ConfigError(f"{name} of grasp {int(np.argmin(finite))} is not finite; give numbers in metres")
    rigid = is_rigid(np.ascontiguousarray(poses))
    if not rigid.all():
        row = int(np.argmin(rigid))
        raise ConfigError(
            f"{name} of grasp {row} is not a rigid motion; give a rotation matrix, a translation and a last row 0 0 0 1"
        )
    far = np.linalg.norm(poses[:, :3, 3], axis=1)
    if far.max() > _FARTHEST:
        row = int(np.argmax(far))
        raise ConfigError(
            f"{name} of grasp {row} is {far[row]:.4g} m from the origin, and at most {_FARTHEST:g} m make sense; give "
            "metres"
        )
