"""Completion: the object's occupancy from what one depth image shows of it.

`CompletionNet` is a small 3-D U-Net over the voxels of a crop. Its labels need no physics: `train_completion` renders
objects as they rest (`graspbox.perception.scenes`) and fills the same voxels with their meshes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox import object_sets
from graspbox.perception.scenes import SceneConfig, SceneSampler
from graspbox.perception.training import TrainConfig, Trained, Trainer, TrainProgress

__all__ = ["CompletionBatch", "CompletionNet", "completion_losses", "iou", "train_completion"]

#: Views of each object in a batch: preparing an object costs more than rendering it.
_VIEWS = 4
#: Number of the first validation scene; training counts from 0.
_VALIDATION_FROM = 1 << 40
#: A voxel is occupied from this share on, as for `graspbox.perception.HandGrid`.
OCCUPIED = 0.25
#: A voxel that is seen to be free by more than this, and in which no object is, does not count in the loss.
_UNSEEN = 0.02


def _double(channels: int) -> nn.Sequential:
    """Two convolutions that are added to their input."""
    return nn.Sequential(
        nn.Conv3d(channels, channels, 3, padding=1, bias=False),
        nn.BatchNorm3d(channels),
        nn.ReLU(inplace=True),
        nn.Conv3d(channels, channels, 3, padding=1, bias=False),
        nn.BatchNorm3d(channels),
    )


class CompletionNet(nn.Module):  # type: ignore[misc]
    """A 3-D U-Net from channels (n, 3, N, N, N) in [0, 1] to logits (n, N, N, N); N is a multiple of 8.

    Parameters
    ----------
    width : int
        Channels at half the resolution; coarser levels have three and six times as many.
    """

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        fine, middle, coarse = width, 3 * width, 6 * width
        self.stem = nn.Conv3d(3, fine, 4, stride=2, padding=1)
        self.down_1 = nn.Conv3d(fine, middle, 2, stride=2)
        self.down_2 = nn.Conv3d(middle, coarse, 2, stride=2)
        self.encode = _double(middle)
        self.bottom = nn.ModuleList([_double(coarse), _double(coarse)])
        self.up_2 = nn.ConvTranspose3d(coarse, middle, 2, stride=2)
        self.decode = _double(middle)
        self.up_1 = nn.ConvTranspose3d(middle, fine, 2, stride=2)
        self.smooth = nn.Sequential(nn.Conv3d(fine, fine, 3, padding=1, bias=False), nn.BatchNorm3d(fine))
        self.head = nn.ConvTranspose3d(fine, 1, 4, stride=2, padding=1)
        self.detail = nn.Conv3d(3, 1, 1)

    def forward(self, channels: Tensor) -> Tensor:
        """Give the logit of every voxel."""
        fine = functional.relu(self.stem(channels))
        middle = self.down_1(fine)
        middle = functional.relu(middle + self.encode(middle))
        coarse = functional.relu(self.down_2(middle))
        for block in self.bottom:
            coarse = functional.relu(coarse + block(coarse))
        middle = functional.relu(middle + self.up_2(coarse))
        middle = functional.relu(middle + self.decode(middle))
        fine = functional.relu(fine + self.up_1(middle))
        fine = functional.relu(fine + self.smooth(fine))
        logits: Tensor = self.head(fine) + self.detail(channels)
        return logits[:, 0]


@dataclass(frozen=True, eq=False)
class CompletionBatch:
    """n samples.

    Attributes
    ----------
    channels : (n, 3, N, N, N) float32
        Channels of crops, 0 to 1.
    solid : (n, N, N, N) float32
        The share of each voxel that the object fills.
    """

    channels: Tensor
    solid: Tensor


def completion_losses(net: nn.Module, batch: CompletionBatch) -> dict[str, Tensor]:
    """Give cross-entropy where the camera does not see free space, and one minus the soft overlap (Dice)."""
    logits = net(batch.channels)
    counts = ((batch.channels[:, 1] > _UNSEEN) | (batch.solid > 0)).float()
    entropy = functional.binary_cross_entropy_with_logits(logits, batch.solid, reduction="none")
    shares = torch.sigmoid(logits)
    overlap = (shares * batch.solid).sum((1, 2, 3))
    total = (shares**2 + batch.solid**2).sum((1, 2, 3))
    return {
        "entropy": (entropy * counts).sum() / counts.sum(),
        "dice": (1.0 - (2.0 * overlap + 1.0) / (total + 1.0)).mean(),
    }


def iou(found: Tensor, solid: Tensor) -> Tensor:
    """Give the intersection over union (n,) of voxels (n, N, N, N) that count as occupied: a quarter full or more."""
    a, b = found >= OCCUPIED, solid >= OCCUPIED
    union = (a | b).sum((1, 2, 3))
    return torch.where(union > 0, (a & b).sum((1, 2, 3)) / union.clamp(min=1), 1.0)


def train_completion(
    folder: Path,
    objects: object_sets.ObjectSet,
    validation: object_sets.ObjectSet,
    config: TrainConfig = TrainConfig(),  # noqa: B008 (frozen)
    scenes: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    *,
    validation_objects: int = 48,
    width: int = 16,
    progress: Callable[[TrainProgress], None] | None = None,
) -> Trained:
    """Train a completion in a folder, or continue there; see `graspbox.perception.training`.

    Parameters
    ----------
    folder : Path
        The run's folder.
    objects, validation : ObjectSet
        What it learns from, and what the best weights are chosen by: the mean overlap (IoU) on objects that it does not
        learn from.
    config : TrainConfig
        How it is trained.
    scenes : SceneConfig
        How objects are seen.
    validation_objects : int
        Objects whose views validate; the same at every validation.
    width : int
        See `CompletionNet`.
    progress : callable, optional
        Called after each step.
    """
    torch.manual_seed(config.seed)
    sampler, held_out = SceneSampler(objects, scenes, config.seed), SceneSampler(validation, scenes, config.seed)
    kept: list[CompletionBatch] = []

    def batch(step: int) -> CompletionBatch:
        return _quick(_mirrored(_batch(sampler, step, max(1, config.batch_size // _VIEWS)), config.seed, step))

    def validate(net: nn.Module) -> dict[str, float]:
        if not kept:
            count = max(1, validation_objects // 4)
            kept.extend(_quick(_batch(held_out, _VALIDATION_FROM + i, 4)) for i in range(count))
        found = torch.cat([iou(torch.sigmoid(net(b.channels)), b.solid) for b in kept])
        return {"iou": float(found.mean()), "iou_of_worst_tenth": float(found.quantile(0.1))}

    net = CompletionNet(width).to(memory_format=torch.channels_last_3d)
    trainer = Trainer(net, Path(folder), config, batch=batch, losses=completion_losses, validate=validate)
    return trainer.run(progress)


def _batch(sampler: SceneSampler, number: int, objects: int) -> CompletionBatch:
    scenes = sampler.sample(number, objects, _VIEWS)
    return CompletionBatch(_unit(scenes.crops.channels), _unit(scenes.solids(sampler.config.crop)))


def _mirrored(batch: CompletionBatch, seed: int, step: int) -> CompletionBatch:
    """Mirror half of the samples along y: the world has no handedness, and a crop frame has its camera at y = 0."""
    flags = torch.from_numpy(np.random.default_rng([seed, step, 1]).random(len(batch.solid)) < 0.5)
    flips = flags[:, None, None, None]
    return CompletionBatch(
        torch.where(flips[:, None], batch.channels.flip(3), batch.channels),
        torch.where(flips, batch.solid.flip(2), batch.solid),
    )


def _unit(values: NDArray[np.uint8]) -> Tensor:
    return torch.from_numpy(values).float() / 255.0


def _quick(batch: CompletionBatch) -> CompletionBatch:
    """Lay the channels of each voxel side by side, as 3-D convolutions on a CPU are faster."""
    return replace(batch, channels=batch.channels.contiguous(memory_format=torch.channels_last_3d))
