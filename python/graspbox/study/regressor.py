"""A trained pose network as a policy of ``GraspPose-v0`` (extra ``[train]``, or ``[onnx]`` for a published one).

The networks predict in the base frame of an object, from views of the study's camera. So the policy first locates the
object in its observation: the centre of everything above the table gives the base frame, whose axes are the
world's.

| input of the network | observation | processing |
|---|---|---|
| ``image``             | ``rgbd``   | locates the object by its depth, shifts the grey image to centre it |
| ``binary``, ``ternary`` | ``voxels`` | crops the cube around the occupied voxels above the table, at 64 voxels |

`graspbox.evaluation.evaluate` makes the environments with `cameras`, which match the study's camera; use them in your
own environments too. A network trained on one side of each object does not generalize to the others:
`Randomization` and resets turn the object, which the study did not do.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspbox import study
from graspbox.configs.cameras import CameraConfig, CamerasConfig
from graspbox.envs.coding import encode_action
from graspbox.errors import ConfigError
from graspbox.perception.cameras import camera_pose
from graspbox.policies.base import Actions, Policy, Task
from graspbox.simulation import load_hand
from graspbox.study.pose_folders import PublishedPoses
from graspbox.study.samples import GRID_SIZE, IMAGE_SIZE, OPAQUE, TRANSPARENT, UNSEEN, grey

if TYPE_CHECKING:
    from graspbox.study.model import PoseModel

__all__ = ["CAMERA", "VOXELS", "PoseRegressor", "cameras"]

#: The mean of the study's views (`graspbox.views`, plan ``study``): 0.7 m away, looking down at 45 degrees.
CAMERA = CameraConfig("front", eye=(-0.7 / 2**0.5, 0.0, 0.05 + 0.7 / 2**0.5), target=(0.0, 0.0, 0.05), fov=0.6, far=5.0)
#: Height above the table below which points do not belong to the object, metres.
_LOWEST = 0.004
#: Distance from the middle of the table beyond which points do not belong to the object, metres.
_REACH = 0.25
#: Side of the cube of voxels, metres, and its voxels: of 6.25 mm, so that the table fills the lowest layer alone.
_SIDE, VOXELS = 0.4, 64


def cameras(kind: str) -> CamerasConfig:
    """Cameras for environments with a `PoseRegressor` whose network takes `kind`."""
    size = IMAGE_SIZE if kind == "image" else 128
    return CamerasConfig(image_size=(size, size), cameras=(CAMERA,), voxels=VOXELS, voxel_side=_SIDE)


class PoseRegressor(Policy):
    """Grasps at the pose that a trained network predicts from one image, or from voxels.

    Without a visible object above the table its actions are zeros, which encode no pose.

    Parameters
    ----------
    model : PoseModel, PublishedPoses or Path
        A trained model, or its folder: of `graspbox.study.training`, run by torch, or of
        `graspbox.study.pose_folders`, run by onnxruntime.

    Raises
    ------
    MissingExtraError
        If torch is needed and not installed.
    FileError, ConfigError
        If the folder holds no model.
    """

    env_id = "graspbox/GraspPose-v0"

    def __init__(self, model: "PoseModel | PublishedPoses | Path | str") -> None:
        self.model = _load(Path(model)) if isinstance(model, str | Path) else model
        self.kind = self.model.config.kind
        self.name = f"{self.model.config.network}-{self.model.config.loss}"
        self._knows: str | None = None
        if isinstance(self.model, PublishedPoses):
            self.name, self._knows = self.model.published.name, self.model.published.hand
            self.learned_from = self.model.published.learned_from
        self.obs = "rgbd" if self.kind == "image" else "voxels"
        self.settings = {"cameras": cameras(self.kind)}

    def _bind(self, task: Task) -> None:
        if task.closed_loop:
            raise ConfigError(f"the policy {self.name!r} acts in graspbox/GraspPose-v0, not in {task.env_id!r}")
        space: Any = task.observation_space
        shape = (space if isinstance(task.obs, str) else space[self.obs]).shape
        wanted = (IMAGE_SIZE, IMAGE_SIZE, 4) if self.kind == "image" else (VOXELS,) * 3
        if shape != wanted:
            raise ConfigError(
                f"the observation {self.obs!r} has shape {shape}, the policy {self.name!r} needs {wanted}; make the "
                f"environments with cameras=graspbox.study.regressor.cameras({self.kind!r})"
            )
        self._hand = load_hand(task.hand)
        if self._knows is not None and self._hand.name != self._knows:
            raise ConfigError(
                f"the policy {self.name!r} was trained for the hand {self._knows!r}, not {self._hand.name!r}"
            )

    def act(self, observation: Any) -> Actions:
        """Predict a pose for every environment."""
        seen = observation if isinstance(self.task.obs, str) else observation[self.obs]
        actions = self._zeros()
        found = [centered_image(row) if self.kind == "image" else cropped_voxels(row, self.kind) for row in seen]
        rows = [i for i, one in enumerate(found) if one is not None]
        if not rows:
            return actions
        inputs, bases = zip(*(one for one in found if one is not None), strict=True)
        poses = np.stack(bases) @ self.model.predict(np.stack(inputs))
        for i, pose in zip(rows, poses, strict=True):
            actions[i] = encode_action(pose, self.model.config.preshape, hand=self._hand)
        return actions


def _load(folder: Path) -> "PoseModel | PublishedPoses":
    """Load a published model, or one from a training's folder."""
    if (folder / "config.json").is_file():
        return PublishedPoses(folder)
    study.require()
    from graspbox.study.model import PoseModel

    return PoseModel.load(folder)


def _base(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """``world_from_base`` (4, 4) under points of an object (n, 3)."""
    pose = np.eye(4)
    pose[:2, 3] = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2
    return pose


def centered_image(rgbd: NDArray[np.floating]) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
    """Locate the object in an image of `CAMERA`, and move it to the middle.

    Parameters
    ----------
    rgbd : (256, 256, 4) float
        The observation ``rgbd``: colour in [0, 1] and depth in metres.

    Returns
    -------
    (256, 256) uint8
        The grey image, shifted by whole pixels so that the object's middle is at its own, as in the study's
        views on average; the border is repeated.
    (4, 4) float64
        ``world_from_base``.

    None if nothing is visible above the table.
    """
    size = IMAGE_SIZE
    depth = np.asarray(rgbd[..., 3], dtype=np.float64)
    focal = size / 2 / np.tan(CAMERA.fov / 2)
    rows, columns = np.mgrid[0:size, 0:size]
    rays = np.stack(
        [(columns + 0.5 - size / 2) / focal, (rows + 0.5 - size / 2) / focal, np.ones((size, size))], axis=2
    )
    pose = camera_pose(CAMERA)
    points = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    near = np.hypot(points[..., 0], points[..., 1]) < _REACH
    is_object = (depth > 0) & (points[..., 2] > _LOWEST) & near
    if not is_object.any():
        return None
    found = points[is_object]
    middle = (found.min(axis=0) + found.max(axis=0)) / 2
    x, y, z = pose[:3, :3].T @ (middle - pose[:3, 3])
    shift = np.rint(np.array([y, x]) / z * focal).astype(int)
    picture = grey(np.rint(np.asarray(rgbd[..., :3]) * 255).astype(np.uint8))
    taken = [np.clip(np.arange(size) + by, 0, size - 1) for by in shift]
    return picture[np.ix_(*taken)], _base(found)


def cropped_voxels(voxels: NDArray[np.integer], kind: str) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
    """Crop the object from the observation ``voxels``, in the cube of its bounds, as binvox takes it.

    Parameters
    ----------
    voxels : (64, 64, 64) integer
        0 unseen, 1 free, 2 occupied, in the cube of `cameras`.
    kind : {"binary", "ternary"}
        Whether to distinguish unseen voxels from free ones.

    Returns
    -------
    (64, 64, 64) uint8
        As in `graspbox.study.samples`; each voxel takes the value of the observation at its centre.
    (4, 4) float64
        ``world_from_base``.

    None if nothing is visible above the table.
    """
    edge = _SIDE / VOXELS
    # The table is in the lowest layer.
    occupied = np.argwhere(voxels[:, :, 1:] == 2) + np.array([0, 0, 1])
    if not len(occupied):
        return None
    low, high = occupied.min(axis=0), occupied.max(axis=0) + 1
    places = low[:, None] + (np.arange(GRID_SIZE) + 0.5) * ((high - low).max() / GRID_SIZE)
    inside = np.minimum(places.astype(int), VOXELS - 1)
    cut = voxels[np.ix_(*inside)]
    # Beyond the observation, voxels are unseen.
    beyond = np.logical_or.outer(np.logical_or.outer(places[0] >= VOXELS, places[1] >= VOXELS), places[2] >= VOXELS)
    cut = np.where(beyond, 0, cut)
    unseen = UNSEEN if kind == "ternary" else TRANSPARENT
    # The centre of the observation's cube is above the world's origin.
    corners = np.stack([low, high]) * edge - [_SIDE / 2, _SIDE / 2, 0.0]
    return np.array([unseen, TRANSPARENT, OPAQUE], dtype=np.uint8)[cut], _base(corners)
