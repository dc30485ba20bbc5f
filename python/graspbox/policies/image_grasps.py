"""Results of `graspbox.policies.grasp_image`: ranked grasps of the thing in an image, or of all its things."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.arms import Reach
from graspbox.hands import Hand
from graspbox.policies.published.configs import DepthPolicyConfig

__all__ = ["EarlierGrasp", "EarlierScene", "ImageGrasps", "SceneGrasps"]


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
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

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
