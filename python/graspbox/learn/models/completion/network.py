"""Completion: an object's occupancy predicted from one depth image.

`CompletionNet` is a small 3-D U-Net over the voxels of a crop. Its labels need no simulation: `train_completion`
renders scenes at rest (`graspbox.learn.models.scenes`) and voxelizes their meshes.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox import object_sets
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.learn.training.trainer import TrainConfig, Trained, Trainer, TrainProgress, moved
from graspbox.simulation.layouts import SceneLayout

__all__ = ["CompletionBatch", "CompletionNet", "completion_losses", "iou", "train_completion"]

#: Views of each scene in a batch: preparing a scene costs more than rendering it.
_VIEWS = 4
#: Number of the first validation scene; training scenes start at 0.
_VALIDATION_FROM = 1 << 40
#: Filled share from which a voxel counts as occupied, as in `graspbox.perception.HandGrid`.
OCCUPIED = 0.25
#: Empty voxels observed free by more than this are excluded from the loss.
_UNSEEN = 0.02


def _double(channels: int) -> nn.Sequential:
    """Two convolutions with a residual connection."""
    return nn.Sequential(
        nn.Conv3d(channels, channels, 3, padding=1, bias=False),
        nn.BatchNorm3d(channels),
        nn.ReLU(inplace=True),
        nn.Conv3d(channels, channels, 3, padding=1, bias=False),
        nn.BatchNorm3d(channels),
    )


class CompletionNet(nn.Module):  # type: ignore[misc]
    """A 3-D U-Net from channels (n, 3, N, N, N) in [0, 1] to logits (n, N, N, N); N is a multiple of 8.

    There are `width` channels at half the resolution; coarser levels have three and six times as many.
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
        """Return the logit of every voxel."""
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
    """Channels (n, 3, N, N, N) of crops, and the share of each voxel that objects fill, both float32, 0 to 1."""

    channels: Tensor
    solid: Tensor


def completion_losses(net: nn.Module, batch: CompletionBatch) -> dict[str, Tensor]:
    """Return the cross-entropy outside observed free space, and one minus the soft Dice overlap."""
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


def iou(predicted: Tensor, solid: Tensor) -> Tensor:
    """Return the intersection over union (n,) of voxels (n, N, N, N); a quarter full or more counts as occupied."""
    a, b = predicted >= OCCUPIED, solid >= OCCUPIED
    union = (a | b).sum((1, 2, 3))
    return torch.where(union > 0, (a & b).sum((1, 2, 3)) / union.clamp(min=1), 1.0)


def train_completion(
    folder: Path,
    objects: object_sets.ObjectSet,
    validation: object_sets.ObjectSet,
    config: TrainConfig = TrainConfig(),  # noqa: B008 (frozen)
    scenes: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    *,
    layouts: Sequence[SceneLayout] = ("single",),
    validation_scenes: int = 48,
    width: int = 16,
    start: CompletionNet | None = None,
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> Trained:
    """Train a completion, or resume it; `folder`, `config` and `progress` as in `graspbox.learn.training.trainer`.

    Parameters
    ----------
    objects, validation : ObjectSet
        Training objects, and held-out objects whose mean overlap (IoU) selects the best weights.
    layouts : sequence of str
        How objects lie in the scenes, in turn.
    validation_scenes : int
        Number of scenes rendered for validation; the same at every validation.
    start : CompletionNet, optional
        A trained network, which is trained further in place, and kept where no step improves on it.
    """
    torch.manual_seed(config.seed)
    sampler, held_out = (SceneSampler(one, scenes, config.seed, layouts) for one in (objects, validation))

    @cache
    def validation_batches() -> list[CompletionBatch]:
        batches = (_quick(_batch(held_out, _VALIDATION_FROM + i, 4)) for i in range(max(1, validation_scenes // 4)))
        return [moved(batch, config.device) for batch in batches]

    def batch(step: int) -> CompletionBatch:
        return _quick(_mirrored(_batch(sampler, step, max(1, config.batch_size // _VIEWS)), config.seed, step))

    def validate(net: nn.Module) -> dict[str, float]:
        overlaps = torch.cat([iou(torch.sigmoid(net(b.channels)), b.solid) for b in validation_batches()])
        return {"iou": float(overlaps.mean()), "iou_of_worst_tenth": float(overlaps.quantile(0.1))}

    net = (CompletionNet(width) if start is None else start).to(memory_format=torch.channels_last_3d)
    settings = {"width": width, "scenes": asdict(scenes), "validation_scenes": validation_scenes}
    settings |= {"layouts": list(layouts), "start": start is not None}
    settings |= {"objects": f"{objects.name} ({len(objects)})", "validation": f"{validation.name} ({len(validation)})"}
    work: dict[str, Any] = {"batch": batch, "losses": completion_losses, "validate": validate}
    return Trainer(net, folder, config, **work, settings=settings, trained=start is not None).run(progress)


def _batch(sampler: SceneSampler, number: int, count: int) -> CompletionBatch:
    scenes = sampler.sample(number, count, _VIEWS)
    return CompletionBatch(_unit(scenes.crops.channels), _unit(scenes.occupancies(sampler.config.crop)))


def _mirrored(batch: CompletionBatch, seed: int, step: int) -> CompletionBatch:
    """Mirror half of the samples along y: scenes have no handedness, and the camera lies at y = 0 of the crop."""
    flags = torch.from_numpy(np.random.default_rng([seed, step, 1]).random(len(batch.solid)) < 0.5)
    flips = flags[:, None, None, None]
    return CompletionBatch(
        torch.where(flips[:, None], batch.channels.flip(3), batch.channels),
        torch.where(flips, batch.solid.flip(2), batch.solid),
    )


def _unit(values: NDArray[np.uint8]) -> Tensor:
    return torch.from_numpy(values).float() / 255.0


def _quick(batch: CompletionBatch) -> CompletionBatch:
    """Use the channels-last layout, which is faster for 3-D convolutions on a CPU."""
    return replace(batch, channels=batch.channels.contiguous(memory_format=torch.channels_last_3d))
