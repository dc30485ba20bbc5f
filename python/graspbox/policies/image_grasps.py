"""Results of `graspbox.policies.grasp_image`: ranked grasps of the thing in an image, or of all its things."""

from dataclasses import dataclass, field, replace
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._common.rotations import upright_pose
from graspbox.arms import Reach, Trajectory, plan_path
from graspbox.configs import PathConfig
from graspbox.errors import ConfigError, MeshError, PathError
from graspbox.hands import Hand
from graspbox.meshes import Mesh, mesh_from_arrays
from graspbox.perception.depth_views import DepthView
from graspbox.perception.shapes import surface_of
from graspbox.policies.arm_reach import ABOVE, ArmAt
from graspbox.policies.published.configs import DepthPolicyConfig

__all__ = ["EarlierGrasp", "EarlierScene", "ImageGrasps", "PathSettings", "SceneGrasps"]

#: Mass of a completed object, which no path depends on, kg.
_ANY_MASS = 0.1


class PathSettings(TypedDict, total=False):
    """Arguments of `graspbox.arms.plan_path` that `ImageGrasps.path` takes too."""

    start: ArrayLike | None
    config: PathConfig
    speed: float
    hand_time: float
    max_duration: float | None
    hz: float
    num_threads: int | None


@dataclass(frozen=True, eq=False)
class EarlierGrasp:
    """The best grasp of an earlier image of a still scene: what is needed of it to keep it.

    Attributes
    ----------
    hand : str
        Name of its hand.
    camera_from_hand, table_from_hand : (4, 4) float64
        Its pose in both frames, metres.
    preshape : float
        See `graspbox.Hand.preshape_limits`.
    """

    hand: str
    camera_from_hand: NDArray[np.float64]
    table_from_hand: NDArray[np.float64]
    preshape: float


@dataclass(frozen=True, eq=False)
class EarlierScene:
    """The best grasps of all things of an earlier image.

    Attributes
    ----------
    labels : (h, w) int64
        As of `SceneGrasps`.
    best_of : dict of int to EarlierGrasp
        The best grasp of each thing that has one.
    """

    labels: NDArray[np.int64]
    best_of: dict[int, EarlierGrasp]


@dataclass(frozen=True, eq=False)
class ImageGrasps:
    """Grasps of the object in an image, the best first; there may be none.

    Attributes
    ----------
    policy : DepthPolicyConfig
        The policy.
    hand : Hand
        The hand.
    depth, intrinsics : (h, w) and (3, 3) float64
        The input image of the networks, metres, and its intrinsics, pixels.
    table_from_camera : (4, 4) float64
        Pose of the camera, metres, corrected; the table is the plane z = 0.
    object : (h, w) bool
        Pixels of the object.
    table_from_crop : (4, 4) float64
        Pose of the occupancy's frame.
    occupancy : (N, N, N) uint8
        The completed object, 0 to 255 for 0 to 1.
    table_from_hand : (k, 4, 4) float64
        Hand poses, metres.
    preshape : (k,) float64
        See `graspbox.Hand.preshape_limits`.
    choice, success, secure : (k,) float64
        Score by which the grasps are ranked, and probabilities that they succeed and that they hold without a shift.
    free : (k,) bool
        Whether the open hand touches nothing that is seen, predicted or given as an obstacle, on a straight approach
        of 0.1 m along its z axis and at the pose.
    lift_free : (k,) bool
        Whether it touches no obstacle either as it is lifted by 0.1 m.
    warnings : tuple of str
        What was assumed of the image, and what may be wrong with it, as sentences.
    reach : Reach, optional
        With an arm: which grasps it reaches, by which joints, and why not; those that it reaches come first.
    arm : ArmAt, optional
        The arm, at its place.
    keep_off : (m, 3) float64
        With an arm: what it keeps off besides the object, seen above the table or given, table's frame, metres.
    """

    policy: DepthPolicyConfig
    hand: Hand
    depth: NDArray[np.float64]
    intrinsics: NDArray[np.float64]
    table_from_camera: NDArray[np.float64]
    object: NDArray[np.bool_]
    table_from_crop: NDArray[np.float64]
    occupancy: NDArray[np.uint8]
    table_from_hand: NDArray[np.float64]
    preshape: NDArray[np.float64]
    choice: NDArray[np.float64]
    success: NDArray[np.float64]
    secure: NDArray[np.float64]
    free: NDArray[np.bool_]
    lift_free: NDArray[np.bool_]
    warnings: tuple[str, ...]
    reach: Reach | None = None
    arm: ArmAt | None = None
    keep_off: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    def __len__(self) -> int:
        """Count the grasps."""
        return len(self.preshape)

    @property
    def camera_from_hand(self) -> NDArray[np.float64]:
        """Hand poses in the camera's frame (k, 4, 4), metres."""
        return np.asarray(np.linalg.inv(self.table_from_camera) @ self.table_from_hand)

    def kept(self, rows: NDArray[np.int64]) -> "ImageGrasps":
        """Return some of the grasps, in this order."""
        names = ("table_from_hand", "preshape", "choice", "success", "secure", "free", "lift_free")
        reach = None if self.reach is None else self.reach[rows]
        return replace(self, reach=reach, **{name: getattr(self, name)[rows] for name in names})

    def by_arm(self, arm: ArmAt, keep_off: NDArray[np.float64], count: int) -> "ImageGrasps":
        """Return `count` grasps, first those that an arm reaches: clear of all that is seen, and of points (m, 3)."""
        seen = DepthView(self.depth, self.intrinsics, self.table_from_camera).points()
        others = seen[~self.object[self.depth > 0]]
        seen, others = (np.concatenate([points, keep_off]) for points in (seen, others))
        seen, others = (points[points[:, 2] > ABOVE] for points in (seen, others))
        reach = arm.reach(self.hand, self.table_from_hand, self.preshape, seen)
        warnings = self.warnings
        if len(reach) and not reach.reached.any():
            counts = ", ".join(f"{why} ({number})" for why, number in reach.counts().items())
            none = f"the arm {reach.arm} reaches none of {len(reach)} grasps: {counts}; move its base or the thing"
            warnings = (*warnings, none)
        known = replace(self, reach=reach, arm=arm, keep_off=others, warnings=warnings)
        return known.kept(reach.first()[:count])

    def path(self, *, place: ArrayLike | None = None, **options: Unpack[PathSettings]) -> Trajectory:
        """Plan and time a path of the arm to the best grasp that has one, and up with the object.

        Only free grasps that the arm reaches are tried. The completed object is grasped and carried; all else that is
        seen, and `keep_off`, are obstacles. What nothing has seen is taken to be free.

        Parameters
        ----------
        place : (3,) array_like, optional
            Where the object is then released: x and y from where it stands, metres, and its turn about z, rad.
        **options
            Further arguments of `graspbox.arms.plan_path`: `PathSettings`. By default ``start`` is the joints that the
            search was given, else home, and ``config`` keeps the distances of the search.

        Returns
        -------
        Trajectory
            Its ``grasp`` is an index of these grasps.

        Raises
        ------
        PathError
            If no grasp has a path.
        ConfigError
            Without an arm, or for a wrong argument.
        MissingExtraError
            Without the package ruckig, of the extra ``arm``.
        """
        if self.arm is None or self.reach is None:
            raise ConfigError("a path needs an arm; pass arm and base to the search for grasps")
        tried = np.flatnonzero(self.free & self.reach.reached)
        if not len(tried):
            raise PathError(
                f"the arm {self.reach.arm} reaches none of the {int(self.free.sum())} free grasps", reason="not_reached"
            )
        found = self._completed()
        given: PathSettings = {"start": self.arm.joints, "config": PathConfig(reach=self.arm.config), **options}
        path = plan_path(
            self.arm.arm,
            self.hand,
            self.table_from_hand[tried],
            self.preshape[tried],
            self.arm.table_from_base,
            target=(found, self.table_from_crop),
            place=None if place is None else self._moved(place, found),
            points=self.keep_off,
            mount=self.arm.mount,
            **given,
        )
        return replace(path, grasp=int(tried[path.grasp]))

    def _completed(self) -> Mesh:
        """Return the completed object in the frame of the crop; what is under the table is cut off."""
        surface = surface_of(self.occupancy, self.policy.crop)
        if surface is None:
            raise PathError("the policy has completed no object to carry", reason="no_object")
        vertices, faces = surface
        vertices[:, 2] = np.maximum(vertices[:, 2], 0.0)
        try:
            return mesh_from_arrays(vertices, faces, mass=_ANY_MASS, name="the object", clean=None)
        except MeshError as error:
            raise PathError(f"the completed object cannot be carried: {error}", reason="no_object") from error

    def _moved(self, place: ArrayLike, found: Mesh) -> NDArray[np.float64]:
        """Return the pose of the crop's frame once its object is moved, and turned about its middle."""
        x, y, angle = _three(place)
        pose = self.table_from_crop
        middle = found.vertices.mean(axis=0) @ pose[:3, :3].T + pose[:3, 3]
        there = np.array([middle[0] + x, middle[1] + y, 0.0])
        from_there = upright_pose([-middle[0], -middle[1], 0.0], 0.0)
        return np.asarray(upright_pose(there, angle) @ from_there @ pose)

    def earlier(self) -> EarlierGrasp | None:
        """Return the best grasp, to be kept in later images; None without one."""
        if not len(self):
            return None
        return EarlierGrasp(self.hand.name, self.camera_from_hand[0], self.table_from_hand[0], float(self.preshape[0]))

    def to_json(self) -> dict[str, Any]:
        """Plain values, as ``graspbox grasp-image`` writes them."""
        in_camera = self.camera_from_hand
        reach: list[dict[str, Any]] = [{}] * len(self)
        if self.reach is not None:
            reach = [{"arm": {"name": self.reach.arm, **entry}} for entry in self.reach.to_json()]
        return {
            "policy": self.policy.name,
            "hand": self.hand.name,
            "table_from_camera": self.table_from_camera.tolist(),
            "warnings": list(self.warnings),
            "grasps": [
                {
                    "rank": rank + 1,
                    "success": float(self.success[rank]),
                    "secure": float(self.secure[rank]),
                    "choice": float(self.choice[rank]),
                    "preshape": float(self.preshape[rank]),
                    "free": bool(self.free[rank]),
                    "lift_free": bool(self.lift_free[rank]),
                    "camera_from_hand": in_camera[rank].tolist(),
                    "table_from_hand": self.table_from_hand[rank].tolist(),
                    **reach[rank],
                }
                for rank in range(len(self))
            ],
        }


@dataclass(frozen=True, eq=False)
class SceneGrasps:
    """Grasps of all things in an image.

    Attributes
    ----------
    labels : (h, w) int64
        Number of the thing that a pixel of the networks' image shows, 0 for none.
    grasps : dict of int to ImageGrasps
        The grasps of each thing.
    refused : dict of int to str
        Why a thing has none.
    """

    labels: NDArray[np.int64]
    grasps: dict[int, ImageGrasps]
    refused: dict[int, str]

    def earlier(self) -> EarlierScene:
        """Return the best grasp of each thing, to be kept in later images."""
        best = {label: one.earlier() for label, one in self.grasps.items()}
        return EarlierScene(self.labels, {label: one for label, one in best.items() if one is not None})

    def path(self, **options: Any) -> tuple[int, Trajectory]:
        """Plan a path to the best grasp that has one; returns the number of its thing too.

        Arguments and errors as of `ImageGrasps.path`.
        """
        failures: dict[int, str] = {}
        for label in dict.fromkeys(label for label, _ in self.best()):
            try:
                return label, self.grasps[label].path(**options)
            except PathError as error:
                failures[label] = str(error)
        counted = "; ".join(f"thing {label}: {why}" for label, why in failures.items())
        failed = tuple(failures.values())
        raise PathError(f"no thing has a path: {counted or 'none has a grasp'}", "", "not_reached", failed)

    def best(self) -> list[tuple[int, int]]:
        """Return thing and rank of all grasps: first those that an arm reaches, then free ones, then by success."""
        pairs = [
            (
                one.reach is not None and not one.reach.reached[rank],
                not one.free[rank],
                -float(one.success[rank]),
                label,
                rank,
            )
            for label, one in self.grasps.items()
            for rank in range(len(one))
        ]
        return [(label, rank) for *_, label, rank in sorted(pairs)]

    def to_json(self) -> dict[str, Any]:
        """Plain values, as ``graspbox grasp-image --all`` writes them."""
        sizes = {label: int((self.labels == label).sum()) for label in (*self.grasps, *self.refused)}
        things = [{"thing": label, "pixels": sizes[label], **one.to_json()} for label, one in self.grasps.items()]
        refused = [{"thing": label, "pixels": sizes[label], "refused": why} for label, why in self.refused.items()]
        order = [{"thing": label, "rank": rank + 1} for label, rank in self.best()]
        return {"things": sorted([*things, *refused], key=lambda row: int(row["thing"])), "order": order}


def _three(place: ArrayLike) -> NDArray[np.float64]:
    numbers = floats(place, "place")
    if numbers.shape != (3,):
        raise ConfigError(f"place has the shape {numbers.shape}; give (3,): x and y in metres, and an angle in rad")
    return numbers
