"""Ranked grasps for your own depth image, by a published policy.

| name | purpose |
|---|---|
| `grasp_image`  | grasps for one image |
| `ImageGrasper` | the same for many: networks are loaded once |
| `ImageGrasps`  | the result |
"""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.downloads import folder_of
from graspbox.artifacts.folders import hand_of, read_depth_policy
from graspbox.artifacts.runtimes import Backend
from graspbox.errors import ConfigError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.perception.crops import Crops
from graspbox.perception.depth_images import (
    check_intrinsics,
    check_points,
    check_pose,
    check_table,
    fit_table,
    thinned,
)
from graspbox.perception.depth_views import DepthView
from graspbox.perception.finder import Clock, GraspFinder, Ranked, TrainedScore
from graspbox.perception.outputs import check_finite
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.shapes import rehearsed_success
from graspbox.policies.depth import load_finder

__all__ = ["ImageGrasper", "ImageGrasps", "grasp_image"]

#: Grasps nearer than both to a better one are omitted, metres and radians.
_NEAR, _ALIKE = 0.01, 0.26


@dataclass(frozen=True, eq=False)
class ImageGrasps:
    """Grasps of the object in an image, the best first; there may be none.

    Attributes
    ----------
    policy : DepthPolicyConfig
        The policy that found them.
    hand : Hand
        The hand.
    depth : (h, w) float64
        The image given to the networks, metres.
    intrinsics : (3, 3) float64
        Its intrinsics, pixels.
    table_from_camera : (4, 4) float64
        Pose of the camera, metres, corrected; the table is the plane z = 0.
    object : (h, w) bool
        Pixels of the object.
    table_from_crop : (4, 4) float64
        Pose of the occupancy's frame.
    occupancy : (N, N, N) uint8
        The object's occupancy as the policy completes it, 0 to 255 for 0 to 1.
    table_from_hand : (k, 4, 4) float64
        Hand poses, metres.
    preshape : (k,) float64
        See `graspbox.Hand.preshape_limits`.
    choice, success, secure : (k,) float64
        Score by which the grasps are ranked, and probabilities that they succeed and that they hold without a shift.
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

    def __len__(self) -> int:
        """Count the grasps."""
        return len(self.preshape)

    @property
    def camera_from_hand(self) -> NDArray[np.float64]:
        """Hand poses in the camera's frame (k, 4, 4), metres."""
        return np.asarray(np.linalg.inv(self.table_from_camera) @ self.table_from_hand)

    def to_json(self) -> dict[str, Any]:
        """Plain values, as ``graspbox grasp-image`` writes them."""
        in_camera = self.camera_from_hand
        return {
            "policy": self.policy.name,
            "hand": self.hand.name,
            "table_from_camera": self.table_from_camera.tolist(),
            "grasps": [
                {
                    "rank": rank + 1,
                    "success": float(self.success[rank]),
                    "secure": float(self.secure[rank]),
                    "choice": float(self.choice[rank]),
                    "preshape": float(self.preshape[rank]),
                    "camera_from_hand": in_camera[rank].tolist(),
                    "table_from_hand": self.table_from_hand[rank].tolist(),
                }
                for rank in range(len(self))
            ],
        }


class ImageGrasper:
    """A published policy, ready to find grasps in depth images; threads may share it.

    Parameters
    ----------
    policy : str or PathLike
        The folder of a published policy of one depth image, the name of an installed one, or ``hf://owner/name``.
    hand : str, Hand or pair of paths, optional
        As for `grasp_image`.
    backend : {"onnx", "torch"}
        Runs the networks.
    num_threads : int, optional
        Threads of onnxruntime; by default one per core.

    Raises
    ------
    ConfigError, MissingExtraError
        If the folder holds no such policy, lacks a file, or onnxruntime or the package of the policy is not installed.
    """

    def __init__(
        self,
        policy: str | os.PathLike[str],
        *,
        hand: HandLike | None = None,
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        folder = folder_of(policy)
        self.config = read_depth_policy(folder)
        self.hand = load_hand(hand_of(folder, self.config) if hand is None else hand)
        self._finder = load_finder(folder, self.config, self.hand, backend=backend, num_threads=num_threads)

    def find(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike | None = None,
        *,
        count: int = 5,
        region: tuple[int, int, int, int] | None = None,
        mask: NDArray[np.bool_] | None = None,
        keep_off: ArrayLike | None = None,
        hand_error: PoseNoise | None = None,
        rehearsed: int | None = None,
        seed: int = 0,
    ) -> ImageGrasps:
        """Find grasps of the object that a depth image shows; arguments and errors as `grasp_image`."""
        image = np.asarray(depth, dtype=np.float64)
        if image.ndim != 2:
            raise ConfigError(f"depth has shape {image.shape}; give one image (H, W)")
        if count < 1:
            raise ConfigError(f"count is {count}; give 1 or more")
        lens = check_intrinsics(intrinsics, (image.shape[0], image.shape[1]))
        pose = fit_table(image, lens) if table_from_camera is None else check_pose(table_from_camera)
        small, lens, step = thinned(image, lens)
        view = DepthView(small, lens, pose).leveled()
        pose = np.asarray(view.world_from_camera)
        check_table(small, lens, pose)
        within = None if region is None else _thin(_within(region, image.shape), step, small.shape)
        crops = view.crops(self.config.crop, within=within)
        _check_object(crops, small)
        finder = self._finder if hand_error is None else self._finder.tolerating(hand_error)
        finder = finder if rehearsed is None else finder.rehearsing(rehearsed)
        if keep_off is not None:
            if table_from_camera is None:
                raise ConfigError(
                    "keep_off is in the table's frame, which a table found in the image does not fix; give "
                    "table_from_camera"
                )
            finder = finder.keeping_off(check_points(keep_off))
        if mask is not None:
            pixels = _thin(_checked(mask, image.shape), step, small.shape)
            finder = _targeting(finder, view.voxels(pixels, crops.world_from_crop[0], finder.crop))
        ranked, success, secure = _ranked(finder, crops, count, seed)
        return ImageGrasps(
            policy=self.config,
            hand=self.hand,
            depth=small,
            intrinsics=lens,
            table_from_camera=pose,
            object=crops.object[0],
            table_from_crop=crops.world_from_crop[0],
            occupancy=ranked.volume[0],
            table_from_hand=crops.world_from_crop[0] @ ranked.poses,
            preshape=ranked.preshapes,
            choice=ranked.scores,
            success=success,
            secure=secure,
        )


def grasp_image(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    table_from_camera: ArrayLike | None,
    policy: str | os.PathLike[str],
    *,
    hand: HandLike | None = None,
    count: int = 5,
    region: tuple[int, int, int, int] | None = None,
    mask: NDArray[np.bool_] | None = None,
    keep_off: ArrayLike | None = None,
    hand_error: PoseNoise | None = None,
    rehearsed: int | None = None,
    backend: Backend = "onnx",
    seed: int = 0,
) -> ImageGrasps:
    """Find grasps of the object that a depth image shows.

    Parameters
    ----------
    depth : (H, W) array
        Metres along the optical axis, of any size; 0 where nothing was measured.
    intrinsics : (3, 3) array
        Pixels.
    table_from_camera : (4, 4) array or None
        Pose of the camera: z forward, x right, y down; the table is the plane z = 0, metres. Small errors of height and
        tilt are corrected (`graspbox.perception.leveling.level`). None: the table is the largest plane in the image
        (`graspbox.perception.depth_images.fit_table`).
    policy : str or PathLike
        The folder of a published policy of one depth image, the name of an installed one, or ``hf://owner/name``.
    hand : str, Hand or pair of paths, optional
        The hand, for a policy that grasps with any; by default that of the policy.
    count : int
        Most grasps; near-duplicates of a better grasp are omitted.
    region : (int, int, int, int), optional
        Columns and rows, left, top, right and bottom, within which the object is searched; by default it is the
        largest object on the table.
    mask : (H, W) bool array, optional
        Pixels of one of several objects: grasps are of this one, and keep off the others. For policies that learned
        among several objects.
    keep_off : (k, 3) array, optional
        Points of what is known to stand there, such as the walls of a bin (`graspbox.layouts.bin_points`), close
        together, in the table's frame, metres; needs `table_from_camera`. Grasps keep off them where any can.
    hand_error : PoseNoise, optional
        Expected error of your hand's pose: grasps are then ranked by their mean score under such errors. The
        probabilities remain those of a hand without error.
    rehearsed : int, optional
        How many of the best grasps are first tried in simulation on the completed shape, for a single object
        (`graspbox.perception.configs.RehearsalConfig`); by default as in the policy's folder.
    backend : {"onnx", "torch"}
        Runs the networks.
    seed : int
        Seed of the refinement.

    Raises
    ------
    ConfigError
        If no object is found, the pose does not fit the image, an output of the networks is not finite, an
        argument is wrong, or the policy lacks a file.
    MissingExtraError
        If onnxruntime or the package of the policy is not installed.
    """
    grasper = ImageGrasper(policy, hand=hand, backend=backend)
    return grasper.find(
        depth,
        intrinsics,
        table_from_camera,
        count=count,
        region=region,
        mask=mask,
        keep_off=keep_off,
        hand_error=hand_error,
        rehearsed=rehearsed,
        seed=seed,
    )


def _ranked(
    finder: GraspFinder, crops: Crops, count: int, seed: int
) -> tuple[Ranked, NDArray[np.float64], NDArray[np.float64]]:
    """Rank the grasps that differ, the best first, with their probabilities of success and of a secure hold."""
    ranked = finder.rank(crops, seed, Clock())
    ranked = ranked.kept(_distinct(ranked, count))
    assert isinstance(finder.score, TrainedScore)
    judged = finder.score.judge(ranked.volume, ranked.poses, ranked.preshapes)
    for values in (judged.choice, judged.success, judged.secure):
        check_finite(values, "scorer")
    success = judged.success
    if ranked.rehearsed is not None and finder.config.rehearsal is not None:
        success = rehearsed_success(success, ranked.rehearsed, finder.config.rehearsal)
    elif finder.config.hand_error is None:
        ranked = ranked._replace(scores=judged.choice)
    order = ranked.best(count)
    return ranked.kept(order), success[order], judged.secure[order]


def _check_object(crops: Crops, depth: NDArray[np.float64]) -> None:
    """Refuse an image (h, w) in which no object was found."""
    if not crops.found[0]:
        measured = depth[depth > 0]
        raise ConfigError(
            f"no object stands out of the table, at depths of {measured.min():.3g} to {measured.max():.3g} m; check "
            "the camera's pose,  the intrinsics and the depth scale, or give another region"
        )


def _within(region: tuple[int, int, int, int], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mark the pixels of a region in an image."""
    left, top, right, bottom = region
    if not (0 <= left < right <= shape[1] and 0 <= top < bottom <= shape[0]):
        raise ConfigError(f"region is {region}; give left < right <= {shape[1]} and top < bottom <= {shape[0]}")
    full = np.zeros(shape, dtype=np.bool_)
    full[top:bottom, left:right] = True
    return full


def _checked(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    found = np.asarray(mask)
    if found.shape != shape or found.dtype != np.bool_:
        raise ConfigError(f"mask is {found.dtype} of shape {found.shape}; give bool {shape}, as the image")
    return found


def _targeting(finder: GraspFinder, visible: NDArray[np.bool_]) -> GraspFinder:
    """Give a finder for the object that is seen in these voxels (N, N, N) of the crop."""
    if not visible.any():
        raise ConfigError(
            f"the mask shows nothing in the {finder.crop.side:.2f} m around the objects on the table; give the mask of "
            "one of them, or a region around it"
        )
    return finder.targeting(visible)


def _thin(full: NDArray[np.bool_], step: int, small: tuple[int, ...]) -> NDArray[np.bool_]:
    """Take the pixels of the thinned image."""
    return np.ascontiguousarray(full[step // 2 :: step, step // 2 :: step][: small[0], : small[1]])


def _distinct(ranked: Ranked, count: int) -> NDArray[np.int64]:
    """Choose the best grasps that differ, by index."""
    chosen: list[int] = []
    for index in ranked.best(len(ranked.scores)).tolist():
        pose, kept = ranked.poses[index], ranked.poses[chosen]
        distances = np.linalg.norm(kept[:, :3, 3] - pose[:3, 3], axis=1)
        traces = np.einsum("nij,ij->n", kept[:, :3, :3], pose[:3, :3])
        angles = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        if not ((distances < _NEAR) & (angles < _ALIKE)).any():
            chosen.append(index)
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=np.int64)
