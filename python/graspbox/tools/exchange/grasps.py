"""Grasps of one object and one hand, for export and import."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats, shown
from graspbox._common.by_value import ByValue
from graspbox._core import MESH_SUFFIXES, Hand, Mesh, is_rigid
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.conventions import Frame, frame_from_hand, mechanism_of
from graspbox.hands.description import describe, independent
from graspbox.meshes import MeshLike, as_mesh, load_mesh
from graspbox.planning.plan_files import mesh_hash

__all__ = ["MAX_GRASPS", "ExchangeGrasps", "beyond_by_unit", "mesh_file_in", "own_mesh"]

Array = NDArray[np.float64]

#: Most grasps of one object.
MAX_GRASPS = 1_000_000
#: Farthest that a hand or an object may be from the origin, metres; millimetres taken for metres are farther.
_FARTHEST = 10.0
#: Columns with a pose, with joint positions and with a number per grasp.
_POSES, _JOINTS = ("poses", "world_from_object"), ("pregrasp", "grasp", "squeeze")
_COLUMNS = (*_POSES, *_JOINTS, "preshape", "success", "confidence", "score")


@dataclass(frozen=True, eq=False, repr=False)
class ExchangeGrasps(ByValue):
    """n grasps of one object, with the data of the object that other programs need.

    Make them with `of`, or with the functions of `graspbox.tools.exchange`. A slice, a mask or an array of indices
    selects rows. NaN marks unknown values.

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
    object_name, mesh_file, mesh_sha256 : str
        The object, its mesh file (of files that graspbox wrote, relative to their folder), and the hash of its mesh
        (`graspbox.planning.plan_files.mesh_hash`); the last two may be empty.
    scale, mass : float
        Metres per unit of the mesh file; kg.
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
        for name in _COLUMNS:
            shape = (count, 4, 4) if name in _POSES else (count, joints) if name in _JOINTS else (count,)
            if (own_shape := getattr(self, name).shape) != shape:
                raise ConfigError(f"{name} has shape {own_shape}; it must be {shape}")
        if count > MAX_GRASPS:
            raise ConfigError(f"there are {count} grasps of {self.object_name!r}; pass at most {MAX_GRASPS}")
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
                raise ConfigError(f"{name} of grasp {row} is {values[row]}; pass a number from {least:g} to {most:g}")
        if not 0 < self.scale < float("inf"):
            raise ConfigError(f"scale is {shown(self.scale)}; pass metres per unit of the mesh file, more than 0")
        if not (np.isnan(self.mass) or 0 < self.mass < float("inf")):
            raise ConfigError(f"mass is {shown(self.mass)}; pass kilograms, more than 0, or NaN where it is unknown")

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
        success, confidence, score : (n,) array_like, or float, optional
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
        loaded, matrices = load_hand(hand), floats(poses, "poses")
        if matrices.ndim != 3:
            raise ConfigError(f"poses has shape {matrices.shape}; pass (n, 4, 4)")
        count = len(matrices)
        shapes = _rows(default_preshape(loaded) if preshape is None else preshape, "preshape", (count,))
        nothing = np.full((count, len(loaded.joints)), np.nan)
        return cls(
            hand=loaded,
            poses=matrices.copy(),
            preshape=shapes,
            success=_rows(success, "success", (count,)),
            confidence=_rows(confidence, "confidence", (count,)),
            score=_rows(score, "score", (count,)),
            world_from_object=_rows(world_from_object, "world_from_object", (count, 4, 4)),
            pregrasp=_open_joints(loaded, shapes),
            grasp=nothing,
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
            raise ConfigError(f"{index} selects one row; use a slice or a list of indices, such as [[{index}]]")
        kept = np.arange(len(self))[index]
        return replace(self, **{name: getattr(self, name)[kept] for name in _COLUMNS})

    @property
    def closed(self) -> NDArray[np.bool_]:
        """Mask (n,) of the grasps whose joint positions at the end of closing are known."""
        return np.asarray(~np.isnan(self.grasp).any(axis=1))

    def object_from(self, frame: Frame) -> Array:
        """Return the poses (n, 4, 4) of the frame ``base`` or ``gripper`` of the hand in the object's frame, metres.

        `graspbox.hands.conventions` defines the frames.
        """
        return np.asarray(self.poses @ np.linalg.inv(frame_from_hand(self.hand, frame)))

    @property
    def beyond_limits(self) -> float:
        """How far a joint position of any stage is beyond its limits, where the stops are soft; rad or m."""
        return max(beyond_by_unit(self).values(), default=0.0)

    def within_limits(self) -> Self:
        """Return the grasps with joint positions at most at their limits, beyond which other programs refuse them."""
        low, high = mechanism_of(self.hand).limits.T
        return replace(self, **{name: np.clip(getattr(self, name), low, high) for name in _JOINTS})

    def load_mesh(self, folder: str | os.PathLike[str] = ".") -> Mesh:
        """Read the mesh of `mesh_file`, in metres, with the mass if that is known.

        Parameters
        ----------
        folder : str or PathLike
            Where `mesh_file` begins, if it is relative: of files that graspbox wrote, their own folder.

        Raises
        ------
        ConfigError
            If the file of the grasps names no mesh.
        FileError, MeshError
            As `graspbox.load_mesh`.
        """
        if not self.mesh_file:
            raise ConfigError(f"the grasps of {self.object_name!r} name no mesh file; load it with graspbox.load_mesh")
        mass = None if np.isnan(self.mass) else self.mass
        return load_mesh(os.path.join(folder, self.mesh_file), scale=self.scale, mass=mass)

    def labeled(self, threshold: float) -> Self:
        """Count unknown successes as successes if their confidence is at least `threshold`, else as failures.

        Raises
        ------
        ConfigError
            If a grasp has neither outcome nor confidence, or `threshold` is not from 0 to 1.
        """
        if not 0 <= threshold <= 1:
            raise ConfigError(f"threshold is {shown(threshold)}; pass a probability from 0 to 1")
        unknown = np.isnan(self.success)
        if np.isnan(self.confidence[unknown]).any():
            raise ConfigError(
                f"threshold needs the confidence of every grasp, and some of {self.object_name!r} have none; simulate "
                "them instead"
            )
        return replace(self, success=np.where(unknown, (self.confidence >= threshold).astype(np.float64), self.success))


def own_mesh(grasps: ExchangeGrasps, mesh: MeshLike) -> Mesh:
    """Return a mesh as that of the grasps; raises ConfigError if they are for another one."""
    loaded = as_mesh(mesh)
    if grasps.mesh_sha256 and grasps.mesh_sha256 != mesh_hash(loaded):
        raise ConfigError(
            f"the grasps are for another mesh, {grasps.object_name!r}, than {loaded.name!r}; pass theirs, in its scale"
        )
    return loaded


def mesh_file_in(name: str) -> str:
    """Return the name that a file of grasps has for its object if it is that of a mesh file, else an empty text."""
    return name if Path(name).suffix.lower() in MESH_SUFFIXES else ""


def beyond_by_unit(grasps: ExchangeGrasps) -> dict[str, float]:
    """Return how far joint positions of any stage are beyond their limits at most, by the unit of the joints."""
    low, high = mechanism_of(grasps.hand).limits.T
    values = np.stack([getattr(grasps, name) for name in _JOINTS])
    beyond = np.nanmax(np.maximum(low - values, values - high), axis=(0, 1), initial=0.0)
    found: dict[str, float] = {}
    for link, most in zip(independent(describe(grasps.hand).links), beyond.tolist(), strict=True):
        found[link.unit] = max(found.get(link.unit, 0.0), most)
    return found


def default_preshape(hand: Hand) -> float:
    """Return the only preshape of a hand; a ConfigError lists several."""
    low, high = hand.preshape_limits
    if high > low:
        known = ", ".join(f"{value:.4g} ({name})" for name, value in hand.preshapes.items())
        raise ConfigError(f"preshape is missing, and {hand.name!r} has several; pass one, for example {known}")
    return low


def _open_joints(hand: Hand, preshape: Array) -> Array:
    low, high = hand.preshape_limits
    values, rows = np.unique(np.clip(preshape, low, high), return_inverse=True)
    opened = [hand.open(float(value)) if np.isfinite(value) else np.full(len(hand.joints), np.nan) for value in values]
    return np.array(opened, dtype=np.float64).reshape(-1, len(hand.joints))[rows]


def _rows(values: ArrayLike | None, name: str, shape: tuple[int, ...]) -> Array:
    """Return an array with one value for each grasp, from such an array or one value; None becomes NaN."""
    if values is None:
        return np.full(shape, np.nan)
    array = floats(values, name)
    if array.shape not in {shape, shape[1:]}:
        one = "pose (4, 4)" if shape[1:] else "number"
        raise ConfigError(f"{name} has shape {array.shape}; pass one {one}, or one for each of {shape[0]} grasps")
    return np.broadcast_to(array, shape).copy()


def _check_poses(poses: Array, name: str) -> None:
    if not len(poses):
        return
    distance = np.linalg.norm(poses[:, :3, 3], axis=1)
    near = distance <= _FARTHEST
    far = f"is {distance[np.argmin(near)]:.4g} m from the origin, and at most {_FARTHEST:g} m make sense; use metres"
    rigid = "is not a rigid motion; use a rotation matrix, a translation and a last row 0 0 0 1"
    for good, problem in (
        (np.isfinite(poses).all(axis=(1, 2)), "is not finite; use numbers in metres"),
        (is_rigid(np.ascontiguousarray(poses)), rigid),
        (near, far),
    ):
        if not good.all():
            raise ConfigError(f"{name} of grasp {int(np.argmin(good))} {problem}")
