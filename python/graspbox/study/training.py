"""Training of a pose network; ``model.json`` in its folder describes the network.

The seed and the iteration's number determine its batch and dropout.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from graspbox._common.rotations import angle_between
from graspbox.errors import ConfigError
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.trainer import Trained, Trainer, TrainProgress
from graspbox.study.losses import Errors, LossWeights
from graspbox.study.model import ModelConfig, PoseModel
from graspbox.study.samples import Samples, Split, labels_of, poses_of_labels

__all__ = ["STUDY", "Objective", "ValidationErrors", "measure", "train"]

#: The study's training, apart from the values of `graspbox.study.reproduction.protocol`: every iteration is logged; a
#: validation error below 99.9 % of the least so far is an improvement; `train` validates once per epoch.
STUDY = TrainConfig(
    optimizer="fused_adam",
    schedule="constant",
    learning_rate=1e-4,
    clip_norm=None,
    batch_size=10,
    max_steps=10**9,
    log_every=1,
    improvement=1e-3,
    max_seconds=float("inf"),
)
#: Greatest number of epochs.
_EPOCHS = 1000


@dataclass(frozen=True)
class Objective:
    """The loss of a pose network; `fit_scaling` scales inputs and positions to mean 0 and variance 1."""

    weights: LossWeights = field(default_factory=LossWeights)
    reduction: Literal["sum", "mean"] = "mean"
    fit_scaling: bool = True

    def __post_init__(self) -> None:
        if self.reduction not in ("sum", "mean"):
            raise ConfigError(f"reduction is {self.reduction!r}; choose sum or mean")


@dataclass(frozen=True)
class ValidationErrors:
    """Mean errors over samples.

    `loss` is their weighted sum; `position` in metres, `rotation` in the unit of the loss, `angle` in radians, which is
    comparable across losses.
    """

    loss: float
    position: float
    rotation: float
    angle: float


def measure(model: PoseModel, samples: Samples, weights: LossWeights) -> ValidationErrors:
    """Compare a model's predictions with the poses of samples; outputs must be finite."""
    labels = labels_of(samples.base_from_hand, model.loss.size)
    predicted = model.labels(samples.inputs)
    errors = Errors.of(model.loss, torch.from_numpy(labels), torch.from_numpy(predicted))
    angles = angle_between(samples.base_from_hand[:, :3, :3], poses_of_labels(predicted)[:, :3, :3])
    total = float(errors.total(weights).mean())
    return ValidationErrors(total, float(errors.position.mean()), float(errors.rotation.mean()), float(angles.mean()))


def train(
    model_config: ModelConfig,
    samples: Samples,
    split: Split,
    folder: Path,
    config: TrainConfig = STUDY,
    objective: Objective = Objective(),
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> tuple[PoseModel, Trained]:
    """Train a network until its validation error stops falling, or a limit is reached; resumes in its folder.

    `config` is `STUDY` with changes; validation follows each epoch, and `patience` counts epochs. `progress` is called
    after each iteration. Returns the model with the least validation error, and the result of its training. Refuses a
    folder with other settings, and a training that diverges.
    """
    learned, validation = samples[split.train], samples[split.validation]
    size = min(config.batch_size, len(learned))
    epoch = len(learned) // size
    config = replace(config, validate_every=epoch, max_steps=min(config.max_steps, _EPOCHS * epoch))
    model = PoseModel(model_config, config.seed)
    labels = torch.from_numpy(labels_of(learned.base_from_hand, model.loss.size))
    if objective.fit_scaling:
        model.fit_scaling(learned.inputs, labels.numpy())

    def batch(step: int) -> tuple[Tensor, Tensor, int]:
        number, place = divmod(step, epoch)
        order = np.random.default_rng([config.seed, number]).permutation(len(learned))
        rows = np.sort(order[place * size : (place + 1) * size])
        return torch.from_numpy(learned.inputs[rows]), labels[rows], step

    def losses(net: Any, batch: tuple[Tensor, Tensor, int]) -> dict[str, Tensor]:
        inputs, wanted, step = batch
        # Seed of the dropout.
        torch.manual_seed(int(np.random.SeedSequence([config.seed, step]).generate_state(1)[0]))
        outputs = net(inputs)
        errors = Errors.of(net.loss, wanted, outputs)
        totals = errors.total(objective.weights)
        shown = {"loss": totals, "position_error": errors.position, "rotation_error": errors.rotation}
        shown["orientation_norm"] = torch.linalg.vector_norm(outputs[:, 3:], dim=1)
        minimized = totals.sum() if objective.reduction == "sum" else totals.mean()
        return {"minimized": minimized, **{name: values.detach().mean() for name, values in shown.items()}}

    def validate(net: Any) -> dict[str, float]:
        mean = measure(net, validation, objective.weights)
        errors = {"position_error": mean.position, "rotation_error": mean.rotation, "angle": mean.angle}
        return {"minus_loss": -mean.loss, "loss": mean.loss, **errors}

    settings = {"model": asdict(model_config), "objective": asdict(objective), "samples": len(samples)}
    trainer = Trainer(model, folder, config, batch=batch, losses=losses, validate=validate, settings=settings)
    trained = trainer.run(progress)
    model.describe(folder)
    if trained.reason != "time":
        # A checkpoint takes up to three times the space of the weights.
        (folder / "checkpoint.pt").unlink(missing_ok=True)
    return model.cpu(), trained
