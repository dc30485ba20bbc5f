"""Export of a trained network of the study: weights as safetensors, and the network as one ONNX file."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox.artifacts.exports import Traced, export
from graspbox.artifacts.onnx_files import PARITY
from graspbox.artifacts.runtimes import onnx_network
from graspbox.artifacts.weight_files import restore_weights, round_weights
from graspbox.errors import ConfigError
from graspbox.study.losses import normalized
from graspbox.study.model import PoseModel
from graspbox.study.pose_folders import PosePolicyConfig, PublishedPoses, predicted

__all__ = ["PoseGraph", "export_pose_model", "load_pose_model"]

_NETWORK, _WEIGHTS = "pose.onnx", "pose.safetensors"


class PoseGraph(nn.Module):  # type: ignore[misc]
    """Maps inputs (n, ...) uint8 to ``base_from_hand`` (n, 4, 4) float32."""

    inputs = ("inputs",)
    outputs = ("poses",)

    def __init__(self, model: PoseModel) -> None:
        super().__init__()
        self.model = model.eval()

    def forward(self, inputs: Tensor) -> Tensor:
        """Return the poses of `PoseModel.predict`, in single precision."""
        found = self.model(inputs)
        angles = found[:, 3:]
        quaternions = normalized(angles) if self.model.loss.size == 4 else _quaternions(angles)
        rows = torch.cat([_rotations(quaternions), found[:, :3, None]], dim=2)
        last = torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(found.shape[0], 1, 4)
        return torch.cat([rows, last], dim=1)


def _quaternions(angles: Tensor) -> Tensor:
    """Convert (roll, pitch, yaw) (n, 3) to quaternions (n, 4), as `graspbox._common.rotations.rotation_from_euler`."""
    (cr, cp, cy), (sr, sp, sy) = torch.cos(angles / 2).unbind(1), torch.sin(angles / 2).unbind(1)
    w, x = cy * cp * cr + sy * sp * sr, cy * cp * sr - sy * sp * cr
    y, z = cy * sp * cr + sy * cp * sr, sy * cp * cr - cy * sp * sr
    return torch.stack([w, x, y, z], dim=1)


def _rotations(quaternions: Tensor) -> Tensor:
    """Convert unit quaternions (n, 4) to rotations (n, 3, 3), as `rotation_from_quaternion` does for arrays."""
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
    learned_from: Iterable[str],
    hand: str = "reflex",
    licence: Path | None = None,
) -> PosePolicyConfig:
    """Export a network of the study.

    Parameters
    ----------
    folder, name, learned_from, hand, licence
        As for `graspbox.artifacts.exports.export_depth_policy`.
    model : PoseModel
        A trained network; its weights are rounded to half precision.
    examples : (n, ...) uint8
        Typical inputs, two or more, on which the ONNX file must predict the network's poses.

    Raises
    ------
    ConfigError
        If the network is too large to be published, or has diverged, or the ONNX file predicts other poses.
    """
    if len(examples) < 2:
        raise ConfigError(f"there are {len(examples)} examples; give two or more")
    round_weights(model)

    def compare(path: Path) -> None:
        found = predicted(onnx_network(path), examples, str(path))
        worst = float(np.abs(found - model.predict(examples)).max())
        if not worst <= PARITY:
            raise ConfigError(f"{path} differs from the network by {worst:.2g}; do not use it")

    config = PosePolicyConfig(name=name, hand=hand, learned_from=tuple(learned_from), model=model.config)
    network = Traced(PoseGraph(model), [torch.from_numpy(examples[:2].copy())], compare=compare)
    return export(folder, config, {_NETWORK: network}, {_WEIGHTS: model}, licence)


def load_pose_model(folder: Path) -> PoseModel:
    """Load a published network from its weights.

    Raises
    ------
    ConfigError
        As `graspbox.artifacts.load`, or if the weights belong to another network.
    """
    model = PoseModel(PublishedPoses(folder).config)
    restore_weights(model, Path(folder) / _WEIGHTS)
    return model
