"""The network that predicts from the hand's sensors whether its grasp will hold (torch)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.errors import ConfigError
from graspbox.learn.training.metrics import auc
from graspbox.learn.training.trainer import TrainConfig, Trained, Trainer, TrainProgress
from graspbox.policies.stability_inputs import STORED_NAME

__all__ = ["StabilityGraph", "StabilityNet", "logits_of", "train_stability"]

#: Smallest scale of an input, in its own unit; inputs constant in training are not scaled.
_LEAST = 1e-3
#: Bound at which standardized inputs are clipped.
_FURTHEST = 5.0


class StabilityNet(nn.Module):  # type: ignore[misc]
    """A multilayer perceptron on standardized inputs, with two hidden layers of `width` units.

    The inputs are vectors of `graspbox.policies.stability_inputs.StabilityReading`.
    """

    def __init__(self, inputs: int, width: int = 64) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("scale", torch.ones(inputs))
        self.layers = nn.Sequential(
            nn.Linear(inputs, width),
            nn.SiLU(),
            nn.Dropout(0.2),
            nn.Linear(width, width),
            nn.SiLU(),
            nn.Dropout(0.2),
            nn.Linear(width, 1),
        )

    def standardize(self, readings: NDArray[np.float32]) -> None:
        """Set mean and scale of the inputs from (n, k) examples."""
        self.mean.copy_(torch.from_numpy(readings.mean(axis=0)))
        self.scale.copy_(torch.from_numpy(np.maximum(readings.std(axis=0), _LEAST)))

    def forward(self, readings: Tensor) -> Tensor:
        """Return the logit (n,) that each grasp holds."""
        inputs = ((readings - self.mean) / self.scale).clamp(-_FURTHEST, _FURTHEST)
        return self.layers(inputs)[:, 0]


class StabilityGraph(nn.Module):  # type: ignore[misc]
    """Maps inputs (n, k) float32 to probabilities (n,), from the mean logit of an ensemble, its slope and offset."""

    inputs = (STORED_NAME,)
    outputs = ("probability",)

    def __init__(self, nets: Sequence[StabilityNet], calibration: tuple[float, float] = (1.0, 0.0)) -> None:
        super().__init__()
        self.nets = nn.ModuleList([net.eval() for net in nets])
        self._slope, self._offset = calibration

    def forward(self, readings: Tensor) -> Tensor:
        """Return the probability that each grasp holds."""
        logits = torch.stack([net(readings) for net in self.nets]).mean(0)
        return torch.sigmoid(logits * self._slope + self._offset)


def logits_of(nets: Sequence[StabilityNet], readings: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the mean logit (n,) of an ensemble for (n, k) examples, before calibration."""
    with torch.no_grad():
        inputs = torch.from_numpy(np.ascontiguousarray(readings, dtype=np.float32))
        logits = torch.stack([net.eval()(inputs) for net in nets]).mean(0)
        return np.asarray(logits.numpy(), dtype=np.float64)


def train_stability(
    folder: Path,
    readings: NDArray[np.float32],
    held: NDArray[np.bool_],
    validation: tuple[NDArray[np.float32], NDArray[np.bool_]],
    config: TrainConfig,
    *,
    width: int = 64,
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> tuple[StabilityNet, Trained]:
    """Train a network, or resume it; `folder` and `progress` as in `graspbox.learn.training.trainer`.

    Parameters
    ----------
    readings, held : (n, k) float32, (n,) bool
        Input vectors, and whether the grasp held.
    validation : pair of arrays
        The same for other objects; the weights with the lowest cross-entropy there are kept.
    config : TrainConfig
        Members of an ensemble differ in its seed.

    Raises ConfigError if there are no examples, or the folder is a run with other settings.
    """
    if not len(readings) or not len(validation[0]):
        raise ConfigError("there are no grasps to learn from, or none to validate with; record more trials")
    torch.manual_seed(config.seed)
    net = StabilityNet(readings.shape[1], width)
    net.standardize(readings)
    inputs, targets = torch.from_numpy(readings), torch.from_numpy(held.astype(np.float32))

    def batch(number: int) -> tuple[Tensor, Tensor]:
        rows = np.random.default_rng([config.seed, number]).integers(len(readings), size=config.batch_size)
        return inputs[rows], targets[rows]

    def losses(net: nn.Module, batch: tuple[Tensor, Tensor]) -> dict[str, Tensor]:
        return {"cross_entropy": functional.binary_cross_entropy_with_logits(net(batch[0]), batch[1])}

    def validate(net: nn.Module) -> dict[str, float]:
        logits = net(torch.from_numpy(validation[0]).to(config.device)).cpu()
        labels = torch.from_numpy(validation[1].astype(np.float32))
        loss = float(functional.binary_cross_entropy_with_logits(logits, labels))
        return {"minus_cross_entropy": -loss, "auc": auc(logits.numpy().astype(np.float64), validation[1])}

    settings = {"inputs": readings.shape[1], "width": width, "trials": len(readings), "validation": len(validation[0])}
    trainer = Trainer(net, folder, config, batch=batch, losses=losses, validate=validate, settings=settings)
    trained = trainer.run(progress)
    return net.cpu(), trained
