"""Heads: a single network from the channels of a crop to grasps, without proposals or collision search.

| head | output | training data |
|---|---|---|
| ``anchor``    | logits of a grid of poses, and residuals (`graspbox.models.head.network`) | successes and failures |
| ``set``       | eight poses with confidences; the pose nearest to a success learns from it | both; failures train the confidence alone |
| ``regressor`` | one pose: position, two columns of the rotation (6-D), preshape | successes |
| ``constant``  | one pose for every input: straight down over the crop's origin | the best of nine, in simulation |

``constant`` is the baseline. The other heads share a trunk, a 2-D U-Net over the crop viewed from above, whose channels are the voxels of each column. The 6-D
rotation is that of Zhou et al., "On the continuity of rotation representations in neural networks", CVPR 2019.
"""  # noqa: E501 (a table)

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.models.head.configs import HeadConfig
from graspbox.models.head.network import AnchorNet
from graspbox.models.head.trunk import Trunk, unit
from graspbox.perception.anchors import Candidates
from graspbox.perception.configs import CropConfig

__all__ = ["ConstantNet", "HeadNet", "PoseNet", "head_of", "rotation_of"]

#: Metres per unit of the positions that `PoseNet` predicts.
_POSITION = 0.05
#: Height of the hand over the table from which predicted heights are offset, metres.
_HEIGHT = 0.12
#: Poses of a set.
_SET = 8
#: Numbers per pose: position 3, rotation 6.
_POSE = 9


class PoseNet(nn.Module):  # type: ignore[misc]
    """Poses with confidences: eight for the kind ``set``, one for ``regressor``.

    Parameters
    ----------
    preshapes, config, crop
        As for `AnchorNet`.
    """

    def __init__(
        self,
        preshapes: int,
        config: HeadConfig,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__()
        self.config, self._preshapes = config, preshapes
        self.count = _SET if config.kind == "set" else 1
        self.trunk = Trunk(crop.resolution, config.width)
        side = crop.resolution // 8
        self.pooled = nn.Sequential(
            unit(config.width, 2 * config.width, 4, 2),
            unit(2 * config.width, 2 * config.width, 4, 2),
            nn.Flatten(),
            nn.Linear(2 * config.width * side * side, 256),
            nn.ReLU(inplace=True),
        )
        self.out = nn.Linear(256, self.count * (_POSE + preshapes + 1))
        with torch.no_grad():
            # Straight down, at different places and rolls.
            bias = torch.zeros(self.count, _POSE + preshapes + 1)
            roll = torch.arange(self.count) * (2.0 * np.pi / self.count)
            bias[:, 3], bias[:, 4] = roll.cos(), roll.sin()
            bias[:, 6], bias[:, 7] = roll.sin(), -roll.cos()
            self.out.bias.copy_(bias.flatten())

    def forward(self, volumes: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Predict positions (n, k, 3) in m, rotations (n, k, 3, 3), preshape logits (n, k, p), confidences (n, k)."""
        found = self.out(self.pooled(self.trunk(volumes))).unflatten(1, (self.count, -1))
        above = torch.tensor([0.0, 0.0, _HEIGHT], device=found.device)
        position = found[..., :3] * _POSITION + above
        return position, rotation_of(found[..., 3:9]), found[..., 9:-1], found[..., -1]

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the poses of one crop (2 or more, N, N, N), by confidence."""
        with torch.no_grad():
            batch = torch.from_numpy(volume[None]).to(self.out.bias.device)
            position, rotation, preshape, confidence = (one[0].cpu() for one in self(batch))
            best, index = torch.sigmoid(confidence).topk(min(count, self.count))
        poses = np.tile(np.eye(4), (len(index), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = rotation[index].numpy(), position[index].numpy()
        return Candidates(poses, preshape[index].argmax(1).numpy(), best.double().numpy())


class ConstantNet(nn.Module):  # type: ignore[misc]
    """One pose for every crop: straight down over its origin.

    Parameters
    ----------
    height : float
        Height of the hand over the table, metres.
    preshape : int
        Index of the preshape.
    """

    def __init__(self, height: float = _HEIGHT, preshape: int = 0) -> None:
        super().__init__()
        self.register_buffer("height", torch.tensor(height, dtype=torch.float64))
        self.register_buffer("preshape", torch.tensor(preshape))

    def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
        """Return the constant pose for any input."""
        del volume, count
        pose = np.diag([1.0, -1.0, -1.0, 1.0])[None]
        pose[0, 2, 3] = float(self.height)
        return Candidates(pose, np.array([int(self.preshape)]), np.ones(1))


def rotation_of(columns: Tensor) -> Tensor:
    """Return rotations (..., 3, 3) from two columns (..., 6), by Gram-Schmidt orthonormalization."""
    first = functional.normalize(columns[..., :3], dim=-1, eps=1e-6)
    second = columns[..., 3:] - (first * columns[..., 3:]).sum(-1, keepdim=True) * first
    second = functional.normalize(second, dim=-1, eps=1e-6)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)


HeadNet = AnchorNet | PoseNet | ConstantNet


def head_of(preshapes: int, config: HeadConfig, crop: CropConfig = CropConfig()) -> HeadNet:  # noqa: B008 (frozen)
    """Build the network of a head."""
    if config.kind == "constant":
        return ConstantNet()
    return AnchorNet(preshapes, config, crop) if config.kind == "anchor" else PoseNet(preshapes, config, crop)
