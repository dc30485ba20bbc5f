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

from graspbox.configs.cameras import CameraConfig, CamerasConfig, camera_pose
from graspbox.envs.coding import encode_action
from graspbox.errors import ConfigError
from graspbox.policies.base import Actions, Policy, Task
from graspbox.simulation import load_hand
from graspbox.study.grasps import base_under
from graspbox.study.pose_folders import PosePolicyConfig, PublishedPoses
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
#: Side of the cube of voxels, metres, and its voxels: of 6.25 mm, so that the table fills only the lowest layer.
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

    #: The class of its ``config.json``, `graspbox.policies.published.registry`.
    config_class = PosePolicyConfig
    env_id = "graspbox/GraspPose-v0"
    _names_poses = True

    def __init__(self, model: "PoseModel | PublishedPoses | Path | str") -> None:
        self.model = _load(Path(model)) if isinstance(model, str | Path) else model
        self.kind = self.model.config.kind
        self.name = f"{self.model.config.network}-{self.model.config.loss}"
        self._trained_hand: str | None = None
        if isinstance(self.model, PublishedPoses):
            self.name, self._trained_hand = self.model.published.name, self.model.published.hand
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
        if self._trained_hand not in (None, self._hand.name):
            raise ConfigError(
                f"the policy {self.name!r} was trained for the hand {self._trained_hand!r}, not {self._hand.name!r}"
            )

    def act(self, observation: Any) -> Actions:
        """Predict a pose for every environment."""
        seen = observation if isinstance(self.task.obs, str) else observation[self.obs]
        actions = self._zeros()
        located = [centered_image(row) if self.kind == "image" else cropped_voxels(row, self.kind) for row in seen]
        objects = {i: one for i, one in enumerate(located) if one is not None}
        if not objects:
            return actions
        inputs, bases = zip(*objects.values(), strict=True)
        poses = np.stack(bases) @ self.model.predict(np.stack(inputs))
        for i, pose in zip(objects, poses, strict=True):
            actions[i] = encode_action(pose, self.model.config.preshape, hand=self._hand)
        return actions


def _load(folder: Path) -> "PoseModel | PublishedPoses":
    """Load a published model, or one from a training's folder."""
    if (folder / "config.json").is_file():
        return PublishedPoses(folder)
    from graspbox import learn

    learn.require("tensorboard")
    from graspbox.study.model import PoseModel

    return PoseModel.load(folder)


def centered_image(rgbd: NDArray[np.floating]) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
    """Locate the object in an image of `CAMERA`, and move it to the middle; None if nothing is above the table.

    `rgbd` (256, 256, 4) has colour in [0, 1] and depth in metres. Returns the grey image (256, 256), shifted by whole
    pixels so that the object's middle is at its own, as in the study's views on average, with the border repeated; and
    ``world_from_base`` (4, 4).
    """
    size = IMAGE_SIZE
    depth = np.asarray(rgbd[..., 3], dtype=np.float64)
    focal = size / 2 / np.tan(CAMERA.fov / 2)
    rows, columns = np.mgrid[0:size, 0:size]
    across, down = ((pixels + 0.5 - size / 2) / focal for pixels in (columns, rows))
    rays = np.stack([across, down, np.ones((size, size))], axis=2)
    pose = camera_pose(CAMERA)
    points = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    near = np.hypot(points[..., 0], points[..., 1]) < _REACH
    is_object = (depth > 0) & (points[..., 2] > _LOWEST) & near
    if not is_object.any():
        return None
    points = points[is_object]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = pose[:3, :3].T @ (middle - pose[:3, 3])
    shift = np.rint(np.array([y, x]) / z * focal).astype(int)
    picture = grey(np.rint(np.asarray(rgbd[..., :3]) * 255).astype(np.uint8))
    taken = [np.clip(np.arange(size) + by, 0, size - 1) for by in shift]
    return picture[np.ix_(*taken)], base_under(points)


def cropped_voxels(voxels: NDArray[np.integer], kind: str) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
    """Crop the object from the observation ``voxels``, in the cube of its bounds, as binvox takes it.

    `voxels` (64, 64, 64) are 0 unseen, 1 free, 2 occupied, in the cube of `cameras`; the kind ``ternary`` distinguishes
    unseen ones from free ones. Returns voxels (64, 64, 64) as in `graspbox.study.samples`, each with the value of the
    observation at its centre, and ``world_from_base`` (4, 4); None if nothing is visible above the table.
    """
    edge = _SIDE / VOXELS
    # The table is in the lowest layer.
    occupied = np.argwhere(voxels[:, :, 1:] == 2) + np.array([0, 0, 1])
    if not len(occupied):
        return None
    low, high = occupied.min(axis=0), occupied.max(axis=0) + 1
    places = low[:, None] + (np.arange(GRID_SIZE) + 0.5) * ((high - low).max() / GRID_SIZE)
    # Beyond the observation, voxels are unseen.
    cut = np.pad(voxels, [(0, 1)] * 3)[np.ix_(*np.minimum(places.astype(int), VOXELS))]
    unseen = UNSEEN if kind == "ternary" else TRANSPARENT
    # The centre of the observation's cube is above the world's origin.
    corners = np.stack([low, high]) * edge - [_SIDE / 2, _SIDE / 2, 0.0]
    return np.array([unseen, TRANSPARENT, OPAQUE], dtype=np.uint8)[cut], base_under(corners)
