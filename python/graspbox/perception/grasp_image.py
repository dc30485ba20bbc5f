"""Grasps for depth images of one's own, ranked, by a published policy.

| name | what it is |
|---|---|
| `grasp_image`  | grasps for one image |
| `ImageGrasper` | the same for many: networks are loaded once |
| `ImageGrasps`  | the result |
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError
from graspbox.perception.crops import Crops, crop
from graspbox.perception.depth_images import check_intrinsics, check_table, thinned
from graspbox.perception.finder import FoundGrasp, GraspFinder
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.leveling import level
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.policy_folders import DepthPolicyConfig, read_depth_policy
from graspbox.perception.runtimes import Backend, load_parts

__all__ = ["ImageGrasper", "ImageGrasps", "grasp_image"]

#: Grasps nearer than both to a better one are left out, metres and radians.
_NEAR, _ALIKE = 0.01, 0.26


@dataclass(frozen=True, eq=False)
class ImageGrasps:
    """Grasps of the object that an image shows, the best first; there may be none.

    Attributes
    ----------
    policy : DepthPolicyConfig
        What found them.
    depth : (h, w) float64
        The image as the policy saw it, metres.
    intrinsics : (3, 3) float64
        Its intrinsics, pixels.
    table_from_camera : (4, 4) float64
        Pose of the camera, metres, corrected; the table is the plane z = 0.
    object : (h, w) bool
        Pixels of the object.
    table_from_crop : (4, 4) float64
        Frame of the occupancy.
    occupancy : (N, N, N) uint8
        What the policy takes the object for, 0 to 255 for 0 to 1.
    table_from_hand : (k, 4, 4) float64
        Where the hand goes, metres.
    preshape : (k,) float64
        See `graspbox.Hand.preshape_limits`.
    choice, success, secure : (k,) float64
        What the grasps are ranked by, and the probabilities that they succeed and that they hold without a shift.
    """

    policy: DepthPolicyConfig
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
        """Where the hand goes, in the camera's frame (k, 4, 4), metres."""
        return np.asarray(np.linalg.inv(self.table_from_camera) @ self.table_from_hand)

    def to_json(self) -> dict[str, Any]:
        """Plain values, as ``graspbox grasp-image`` writes them."""
        in_camera = self.camera_from_hand
        return {
            "policy": self.policy.name,
            "hand": self.policy.hand,
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
        The folder of a published policy.
    backend : {"onnx", "torch"}
        What runs the networks.
    num_threads : int, optional
        Threads of onnxruntime; by default one per core.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        If the folder holds no such policy, lacks a file, or onnxruntime is not installed.
    """

    def __init__(
        self, policy: str | os.PathLike[str], *, backend: Backend = "onnx", num_threads: int | None = None
    ) -> None:
        self.config = read_depth_policy(Path(policy))
        self._grid = HandGrid(self.config.hand, self.config.grid, crop=self.config.crop)
        self._parts = load_parts(Path(policy), self.config, self._grid, backend, num_threads)

    def find(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike,
        *,
        count: int = 5,
        region: tuple[int, int, int, int] | None = None,
        hand_error: PoseNoise | None = None,
        seed: int = 0,
    ) -> ImageGrasps:
        """Find grasps of the object that a depth image shows; arguments and errors as `grasp_image`."""
        image = np.asarray(depth, dtype=np.float64)
        if image.ndim != 2:
            raise ConfigError(f"depth has shape {image.shape}; give one image (H, W)")
        if count < 1:
            raise ConfigError(f"count is {count}; give 1 or more")
        lens = check_intrinsics(intrinsics, (image.shape[0], image.shape[1]))
        pose = np.asarray(table_from_camera, dtype=np.float64)
        small, lens, step = thinned(image, lens)
        check_table(small, lens, pose)
        pose = level(small, lens, pose)
        mask = None if region is None else _mask(region, image.shape, step, small.shape)
        return self._ranked(small, lens, pose, _crop(small, lens, pose, self.config, mask), count, hand_error, seed)

    def _ranked(
        self,
        depth: NDArray[np.float64],
        intrinsics: NDArray[np.float64],
        pose: NDArray[np.float64],
        crops: Crops,
        count: int,
        hand_error: PoseNoise | None,
        seed: int,
    ) -> ImageGrasps:
        """Decide in a crop, and rank the grasps that differ."""
        config, (complete, scorer, head) = self.config, self._parts
        finder = config.finder if hand_error is None else config.finder.tolerating(hand_error)
        found = GraspFinder(self._grid, complete, scorer, finder, crop=config.crop, head=head).decide(crops, seed=seed)
        if found is None:
            chosen, poses, preshapes = np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)), np.zeros(0)
            volume = np.concatenate([complete(crops.channels), crops.channels[0, :2]])
        else:
            chosen, poses, preshapes = _distinct(found, count), found.poses, found.preshapes
            volume = found.volume
        judged = scorer.judge(volume, poses[chosen], preshapes[chosen])
        choice = judged.choice if finder.hand_error is None or found is None else found.scores[chosen]
        order = np.argsort(-choice, kind="stable")
        return ImageGrasps(
            policy=config,
            depth=depth,
            intrinsics=intrinsics,
            table_from_camera=pose,
            object=crops.object[0],
            table_from_crop=crops.world_from_crop[0],
            occupancy=volume[0],
            table_from_hand=crops.world_from_crop[0] @ poses[chosen][order],
            preshape=preshapes[chosen][order],
            choice=choice[order],
            success=judged.success[order],
            secure=judged.secure[order],
        )


def grasp_image(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    table_from_camera: ArrayLike,
    policy: str | os.PathLike[str],
    *,
    count: int = 5,
    region: tuple[int, int, int, int] | None = None,
    hand_error: PoseNoise | None = None,
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
    table_from_camera : (4, 4) array
        Pose of the camera: z forward, x right, y down; the table is the plane z = 0, metres. Small errors of height and
        tilt are corrected (`graspbox.perception.leveling.level`).
    policy : str or PathLike
        The folder of a published policy.
    count : int
        Most grasps; those much like a better one are left out.
    region : (int, int, int, int), optional
        Columns and rows, left, top, right and bottom, within which the object is looked for; by default it is the
        largest thing on the table.
    hand_error : PoseNoise, optional
        How far your hand may go from where it is sent: grasps are then ranked by how well they do over such errors.
        The probabilities stay those of a hand that does not err.
    backend : {"onnx", "torch"}
        What runs the networks.
    seed : int
        Seed of the refinement.

    Raises
    ------
    ConfigError
        If no object is found, the pose does not fit the image, or an argument is wrong.
    FileError, MissingExtraError
        If the policy lacks a file, or onnxruntime is not installed.
    """
    grasper = ImageGrasper(policy, backend=backend)
    return grasper.find(
        depth, intrinsics, table_from_camera, count=count, region=region, hand_error=hand_error, seed=seed
    )


def _crop(
    depth: NDArray[np.float64],
    intrinsics: NDArray[np.float64],
    pose: NDArray[np.float64],
    config: DepthPolicyConfig,
    mask: NDArray[np.bool_] | None,
) -> Crops:
    """Find the object, within a mask (h, w) if there is one, and crop it."""
    images = depth[None].astype(np.float32)
    if mask is None:
        crops = crop(images, intrinsics, pose[None], config=config.crop)
    else:
        within = crop(np.where(mask, images, np.float32(0)), intrinsics, pose[None], config=config.crop)
        crops = crop(images, intrinsics, pose[None], labels=within.object, config=config.crop)
    if not crops.found[0]:
        seen = depth[depth > 0]
        raise ConfigError(
            f"no object stands out of the table, at depths of {seen.min():.3g} to {seen.max():.3g} m; check the "
            "camera's pose, the intrinsics and the depth scale, or give another region"
        )
    return crops


def _mask(
    region: tuple[int, int, int, int], shape: tuple[int, ...], step: int, small: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Mark the pixels of a region in the thinned image."""
    left, top, right, bottom = region
    if not (0 <= left < right <= shape[1] and 0 <= top < bottom <= shape[0]):
        raise ConfigError(f"region is {region}; give left < right <= {shape[1]} and top < bottom <= {shape[0]}")
    full = np.zeros(shape, dtype=np.bool_)
    full[top:bottom, left:right] = True
    return np.ascontiguousarray(full[step // 2 :: step, step // 2 :: step][: small[0], : small[1]])


def _distinct(found: FoundGrasp, count: int) -> NDArray[np.int64]:
    """Choose the best grasps that differ, by index."""
    chosen: list[int] = []
    for index in np.argsort(-found.scores, kind="stable").tolist():
        pose = found.poses[index]
        kept = found.poses[chosen]
        distances = np.linalg.norm(kept[:, :3, 3] - pose[:3, 3], axis=1)
        traces = np.einsum("nij,ij->n", kept[:, :3, :3], pose[:3, :3])
        angles = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        if not ((distances < _NEAR) & (angles < _ALIKE)).any():
            chosen.append(index)
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=np.int64)
