"""The scorer's network: the probability that a grasp holds, from the voxels around the hand.

`ScorerNet` is a small 2-D CNN over the cells of a `graspbox.perception.HandGrid`, whose layers along the hand's x are
channels: the cells have fixed places in the hand, and a 2-D network costs half as much as a 3-D one of the same
accuracy. `graspbox.learn.export.graphs` exports an ensemble as a function from cells to calibrated probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid

__all__ = ["DECIDING", "TARGETS", "ScorerBatch", "ScorerNet", "deciding", "moments_of", "scorer_losses"]

#: The events by which grasps are chosen.
DECIDING = ("success", "secure")
#: The events whose logits the network outputs: those, and one that only helps it to learn.
TARGETS = (*DECIDING, "slip")
#: Number of scalar inputs besides the cells.
_SCALARS = 8
#: Share of a batch that enters the loss: its hardest samples.
_HARDEST = 0.75
#: Weights of the targets in the loss.
_WEIGHTS = (1.0, 0.5, 0.2)
#: Unit of lengths among the scalars, metres.
_LENGTH = 0.1


class ScorerNet(nn.Module):  # type: ignore[misc]
    """A CNN from the outputs of `graspbox.perception.inputs.scorer.ScorerInputs.make` to logits (m, 3) of `TARGETS`.

    Its scalar inputs are 8 numbers: the direction of gravity in the hand frame (3), the height of the hand over the
    table, the centroid of the completed cells from the centre of the grid (3), lengths in units of 0.1 m, and the
    completed share of the cells times 10.

    Y and Z of the grid's cells are multiples of 8. The first layer has `width` channels, the next ones one and a half
    times and twice as many.
    """

    swept: Tensor
    moments: Tensor

    def __init__(self, grid: HandGrid, width: int = 48) -> None:
        super().__init__()
        x, y, z = grid.shape
        self.register_buffer("swept", torch.from_numpy(np.ascontiguousarray(grid.swept)))
        self.register_buffer("moments", moments_of(grid.shape, grid.cell))
        middle, coarse = 3 * width // 2, 2 * width
        self._planes = len(HAND_CHANNELS) * x
        self.stem = nn.Conv2d(self._planes, width, 4, stride=2, padding=1, bias=False)
        #: The region that the fingers sweep is the same for all grasps with a preshape, so it has its own layer.
        self.stem_of_swept = nn.Conv2d(x, width, 4, stride=2, padding=1, bias=False)
        self.trunk = nn.Sequential(
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, middle, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm2d(middle),
            nn.ReLU(inplace=True),
            nn.Conv2d(middle, middle, 3, padding=1, bias=False),
            nn.BatchNorm2d(middle),
            nn.ReLU(inplace=True),
            nn.Conv2d(middle, coarse, 3, stride=2, padding=1, bias=False),
            nn.BatchNorm2d(coarse),
            nn.ReLU(inplace=True),
            nn.Flatten(),
        )
        self.shape_of_preshape = nn.Embedding(len(grid.swept), 8)
        self.head = nn.Sequential(
            nn.Linear(coarse * (y // 8) * (z // 8) + _SCALARS + 8, 128),
            nn.ReLU(inplace=True),
            nn.Linear(128, len(TARGETS)),
        )

    def scalars(self, cells: Tensor, poses: Tensor, scale: Tensor | float = 1.0) -> Tensor:
        """Return the scalar inputs (m, 8) from cells (m, 4, X, Y, Z) uint8 and poses (m, 4, 4).

        `scale` (m, 1) is the size of the cells over that of the network's grid.
        """
        moments = cells[:, 0].flatten(1).float() @ self.moments
        mass = moments[:, 3:]
        middle = moments[:, :3] / mass.clamp(min=1.0)
        share = mass * (10.0 / len(self.moments))
        return torch.cat([-poses[:, 2, :3], poses[:, 2, 3:] / _LENGTH, scale * middle, share], dim=1)

    def layer_of_swept(self, swept: Tensor) -> Tensor:
        """Return the first layer (p, width, Y/2, Z/2) of the regions (p, X, Y, Z) uint8 that the fingers sweep."""
        return functional.conv2d(swept.float(), self.stem_of_swept.weight / 255.0, stride=2, padding=1)

    def logits(
        self, cells: Tensor, poses: Tensor, swept: Tensor, features: Tensor, scale: Tensor | float = 1.0
    ) -> Tensor:
        """Return logits (m, 3), from the `layer_of_swept` and the learned features (m, 8) of each grasp's preshape."""
        # The weights include the scale from bytes to shares, at no cost.
        layers = cells.reshape(-1, self._planes, *cells.shape[3:]).float()
        seen = functional.conv2d(layers, self.stem.weight / 255.0, stride=2, padding=1)
        features_of_cells = self.trunk(seen + swept)
        logits: Tensor = self.head(torch.cat([features_of_cells, self.scalars(cells, poses, scale), features], dim=1))
        return logits

    def forward(self, cells: Tensor, poses: Tensor, preshape: Tensor) -> Tensor:
        """Return logits (m, 3) from cells (m, 4, X, Y, Z) uint8, poses (m, 4, 4) and preshapes (m,) int64."""
        swept = self.layer_of_swept(self.swept)[preshape]
        return self.logits(cells, poses, swept, self.shape_of_preshape(preshape))


def deciding(values: Tensor) -> Tensor:
    """Select the columns (m, 2) of `DECIDING` from those (m, 3) of `TARGETS`."""
    return values[:, : len(DECIDING)]


def moments_of(shape: Sequence[int], cell: float) -> Tensor:
    """Return weights (X * Y * Z, 4) that sum x, y, z and 1 over cells of bytes, in units of `_LENGTH`."""
    along = [(np.arange(n) - (n - 1) / 2) * (cell / _LENGTH) for n in shape]
    grids = [grid.ravel() for grid in np.meshgrid(*along, indexing="ij")]
    weights = np.stack([*grids, np.ones_like(grids[0])], axis=1) / 255.0
    return torch.from_numpy(weights.astype(np.float32))


@dataclass(frozen=True, eq=False)
class ScorerBatch:
    """m grasps, as `graspbox.perception.inputs.scorer.GraspInputs`, with their outcomes (m, 3), 0 or 1: `TARGETS`."""

    cells: Tensor
    poses: Tensor
    preshape: Tensor
    targets: Tensor

    @classmethod
    def of(cls, inputs: Sequence[NDArray[np.generic]], targets: NDArray[np.float32]) -> "ScorerBatch":
        """Convert arrays to tensors."""
        cells, poses, preshape = (torch.from_numpy(array) for array in inputs)
        return cls(cells, poses, preshape, torch.from_numpy(targets))


def scorer_losses(net: nn.Module, batch: ScorerBatch) -> dict[str, Tensor]:
    """Return the weighted cross-entropy of each target, over the hardest three quarters of a batch."""
    logits = net(batch.cells, batch.poses, batch.preshape)
    entropy = functional.binary_cross_entropy_with_logits(logits, batch.targets, reduction="none")
    hardest = max(1, int(_HARDEST * len(entropy)))
    means = entropy.topk(hardest, dim=0).values.mean(0)
    return {name: weight * mean for name, weight, mean in zip(TARGETS, _WEIGHTS, means, strict=True)}
