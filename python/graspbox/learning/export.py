"""Export of a trained network of the study: weights as safetensors, and the network as one ONNX file."""

import shutil
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

import graspbox
from graspbox.errors import ConfigError
from graspbox.learning.losses import normalized
from graspbox.learning.model import PoseModel
from graspbox.learning.pose_folders import PosePolicyConfig, PublishedPoses, write_pose_policy
from graspbox.perception.onnx_files import PARITY, write_onnx
from graspbox.perception.policy_folders import file_hash
from graspbox.perception.weight_files import check_size, restore_weights, round_weights, save_weights

__all__ = ["PoseGraph", "export_pose_model", "load_pose_model"]

_NETWORK, _WEIGHTS = "pose.onnx", "pose.safetensors"


class PoseGraph(nn.Module):  # type: ignore[misc]
    """From inputs (n, ...) uint8 to ``base_from_hand`` (n, 4, 4) float32."""

    inputs = ("inputs",)
    outputs = ("poses",)

    def __init__(self, model: PoseModel) -> None:
        super().__init__()
        self.model = model.eval()

    def forward(self, inputs: Tensor) -> Tensor:
        """Give the poses that `PoseModel.predict` gives, in single precision."""
        found = self.model(inputs)
        angles = found[:, 3:]
        quaternions = normalized(angles) if self.model.loss.size == 4 else _quaternions(angles)
        rows = torch.cat([_rotations(quaternions), found[:, :3, None]], dim=2)
        last = torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(found.shape[0], 1, 4)
        return torch.cat([rows, last], dim=1)


def _quaternions(angles: Tensor) -> Tensor:
    """Quaternions (n, 4) of (roll, pitch, yaw) (n, 3), as `graspbox.rotations.rotation_from_euler`."""
    (cr, cp, cy), (sr, sp, sy) = torch.cos(angles / 2).unbind(1), torch.sin(angles / 2).unbind(1)
    w, x = cy * cp * cr + sy * sp * sr, cy * cp * sr - sy * sp * cr
    y, z = cy * sp * cr + sy * cp * sr, sy * cp * cr - cy * sp * sr
    return torch.stack([w, x, y, z], dim=1)


def _rotations(quaternions: Tensor) -> Tensor:
    """Rotations (n, 3, 3) of unit quaternions (n, 4), as `graspbox.rotations.rotation_from_quaternion`."""
    w, x, y, z = quaternions.unbind(1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def export_pose_model(
    folder: Path,
    name: str,
    model: PoseModel,
    examples: NDArray[np.uint8],
    *,
    hand: str = "reflex",
    licence: Path | None = None,
) -> PosePolicyConfig:
    """Write a policy's folder: network, weights, ``config.json`` last.

    Parameters
    ----------
    folder : Path
        The folder; it is made.
    name : str
        Name of the policy in results.
    model : PoseModel
        A trained network; its weights are rounded to half precision.
    examples : (n, ...) uint8
        Inputs as it meets them, two or more, on which the ONNX file must predict what the network does.
    hand : str
        Name of the hand.
    licence : Path, optional
        A file that is copied as ``LICENSE``.

    Raises
    ------
    ConfigError
        If the network is too large to be published, or has diverged, or the ONNX file predicts other poses.
    """
    check_size(model, f"{name!r}, a {type(model.network).__name__},")
    if len(examples) < 2:
        raise ConfigError(f"there are {len(examples)} examples; give two or more")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    round_weights(model)
    write_onnx(PoseGraph(model), [torch.from_numpy(examples[:2].copy())], True, folder / _NETWORK, [])
    save_weights(model, folder / _WEIGHTS)
    config = PosePolicyConfig(
        name=name,
        graspbox=graspbox.__version__,
        hand=hand,
        model=model.config,
        files={file: file_hash(folder / file) for file in (_NETWORK, _WEIGHTS)},
    )
    write_pose_policy(folder, config)
    worst = float(np.abs(PublishedPoses(folder).predict(examples) - model.predict(examples)).max())
    if not worst <= PARITY:
        (folder / "config.json").unlink()
        raise ConfigError(f"{folder / _NETWORK} differs from the network by {worst:.2g}; do not use it")
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    return config


def load_pose_model(folder: Path) -> PoseModel:
    """Load a published network from its weights.

    Raises
    ------
    ConfigError, FileError
        As `graspbox.learning.pose_folders.read_pose_policy`, or if the weights are another network's.
    """
    model = PoseModel(PublishedPoses(folder).config)
    restore_weights(model, Path(folder) / _WEIGHTS)
    return model
