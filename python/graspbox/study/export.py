"""Export of a trained network of the study as one ONNX file."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.learn.export.exports import Traced, export
from graspbox.learn.export.onnx_files import PARITY
from graspbox.learn.export.weight_files import restore_weights, round_weights
from graspbox.policies.published.runtimes import onnx_network
from graspbox.study.losses import normalized
from graspbox.study.model import PoseModel
from graspbox.study.pose_folders import PosePolicyConfig, PublishedPoses, predicted

__all__ = ["PoseGraph", "export_pose_model", "load_pose_model"]

_NETWORK = "pose.onnx"


class PoseGraph(nn.Module):  # type: ignore[misc]
    """Maps inputs (n, ...) uint8 to ``base_from_hand`` (n, 4, 4) float32."""

    inputs = ("inputs",)
    outputs = ("poses",)

    def __init__(self, model: PoseModel) -> None:
        super().__init__()
        self.model = model.eval()

    def forward(self, inputs: Tensor) -> Tensor:
        """Return the poses of `PoseModel.predict`, in single precision."""
        outputs = self.model(inputs)
        orientation = outputs[:, 3:]
        quaternions = normalized(orientation) if self.model.loss.size == 4 else _quaternions(orientation)
        rows = torch.cat([_rotations(quaternions), outputs[:, :3, None]], dim=2)
        last = torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(outputs.shape[0], 1, 4)
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
    """Export a trained network of the study, whose weights are rounded to half precision.

    `examples` (n, ...) uint8 are typical inputs, two or more, on which the ONNX file must predict the network's poses;
    the other parameters are those of `graspbox.learn.export.exports.export_depth_policy`. A `ConfigError` says if the
    network is too large to be published, or has diverged.
    """
    if len(examples) < 2:
        raise ConfigError(f"there are {len(examples)} examples; pass two or more")
    round_weights(model)

    def compare(path: Path) -> None:
        worst = float(np.abs(predicted(onnx_network(path), examples, str(path)) - model.predict(examples)).max())
        if not worst <= PARITY:
            raise ConfigError(f"{path} differs from the network by {worst:.2g}; do not use it")

    config = PosePolicyConfig(name=name, hand=hand, learned_from=tuple(learned_from), model=model.config)
    network = Traced(PoseGraph(model), [torch.from_numpy(examples[:2].copy())], compare=compare)
    return export(folder, config, {_NETWORK: network}, licence)


def load_pose_model(folder: Path) -> PoseModel:
    """Load a published network from its weights, which must belong to it."""
    model = PoseModel(PublishedPoses(folder).config)
    restore_weights(model, Path(folder) / _NETWORK, "model.")
    return model
