"""Training of a pose network: optimisers by name, early stopping, logs, checkpoints.

A run has a folder:

| file | contents |
|---|---|
| ``run.json``         | its settings |
| ``iterations.csv``   | a row per iteration: errors of the batch |
| ``validations.csv``  | a row per epoch: errors of the validation samples |
| ``tensorboard/``     | the same for TensorBoard |
| ``model.json``, ``weights.pt`` | the model with the least validation error so far (`graspbox.learning.model`) |
| ``checkpoint.pt``    | what an interrupted run continues from; removed at the end |
| ``result.json``      | written at the end: why it stopped, iterations, seconds, errors |

The batch of an iteration and its dropout follow from the seed and the iteration's number alone, so a run that was
interrupted gives the same bits as one that was not, with the same number of threads of torch.
"""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter

from graspbox.errors import ConfigError
from graspbox.files import replacing, write_text
from graspbox.learning.losses import Errors, LossWeights
from graspbox.learning.model import ModelConfig, PoseModel
from graspbox.learning.samples import Samples, Split, labels_of, poses_of_labels
from graspbox.rotations import angle_between

__all__ = ["OPTIMIZERS", "Measured", "TrainConfig", "measure", "train"]

Optimizer = Literal["sgd", "momentum", "nesterov", "adagrad", "adam", "delta_bar_delta"]
OPTIMIZERS = get_args(Optimizer)
#: A validation error counts as an improvement below this share of the least so far.
_IMPROVED = 0.999
#: Columns of the logs.
_ITERATION = ("iteration", "epoch", "seconds", "loss", "position_error", "rotation_error", "orientation_norm")
_VALIDATION = ("iteration", "epoch", "seconds", "loss", "position_error", "rotation_error", "angle")


@dataclass(frozen=True)
class TrainConfig:
    """How a network is trained.

    Attributes
    ----------
    optimizer : {"sgd", "momentum", "nesterov", "adagrad", "adam", "delta_bar_delta"}
        ``delta_bar_delta`` is torch's ``Rprop``, the member of that family that adapts each weight's step by the sign
        of its gradient alone.
    learning_rate : float
        Learning rate; of ``delta_bar_delta`` the first step of each weight.
    momentum : float
        Of ``momentum`` and ``nesterov``.
    batch_size : int
        Samples per iteration.
    weights : LossWeights
        Weights of the two errors.
    reduction : {"sum", "mean"}
        Whether the loss of a batch is the sum or the mean over its samples.
    fit_scaling : bool
        Whether inputs and positions are scaled to mean 0 and variance 1.
    patience : int
        Epochs without a smaller validation error after which training stops.
    max_epochs : int
        Epochs after which it stops in any case.
    seed : int
        Seed of weights, batches and dropout.
    """

    optimizer: Optimizer = "adam"
    learning_rate: float = 1e-4
    momentum: float = 0.5
    batch_size: int = 10
    weights: LossWeights = field(default_factory=LossWeights)
    reduction: Literal["sum", "mean"] = "mean"
    fit_scaling: bool = True
    patience: int = 10
    max_epochs: int = 1000
    seed: int = 0

    def __post_init__(self) -> None:
        if self.optimizer not in OPTIMIZERS:
            raise ConfigError(f"optimizer is {self.optimizer!r}; choose from {', '.join(OPTIMIZERS)}")
        if self.reduction not in ("sum", "mean"):
            raise ConfigError(f"reduction is {self.reduction!r}; choose sum or mean")
        if not 0.0 < self.learning_rate < float("inf"):
            raise ConfigError(f"learning_rate is {self.learning_rate}; give a positive number")
        if not 0.0 <= self.momentum < 1.0:
            raise ConfigError(f"momentum is {self.momentum}; give a number in [0, 1)")
        for name in ("batch_size", "patience", "max_epochs"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}; give 1 or more")

    def make(self, model: PoseModel) -> torch.optim.Optimizer:
        """Make the optimiser of a model."""
        rate, weights = self.learning_rate, model.parameters()
        if self.optimizer == "adam":
            return torch.optim.Adam(weights, rate, fused=True)
        if self.optimizer == "adagrad":
            return torch.optim.Adagrad(weights, rate)
        if self.optimizer == "delta_bar_delta":
            return torch.optim.Rprop(weights, rate)
        momentum = 0.0 if self.optimizer == "sgd" else self.momentum
        return torch.optim.SGD(weights, rate, momentum=momentum, nesterov=self.optimizer == "nesterov")


@dataclass(frozen=True)
class Measured:
    """Mean errors over samples.

    Attributes
    ----------
    loss : float
        Weighted sum of the two errors, with the weights of training.
    position : float
        Distance between true and predicted position, metres.
    rotation : float
        Orientation error, in the unit of the loss.
    angle : float
        Angle between true and predicted orientation, radians; the same measure for every loss.
    """

    loss: float
    position: float
    rotation: float
    angle: float


def measure(model: PoseModel, samples: Samples, weights: LossWeights) -> Measured:
    """Compare a model's predictions with the poses of samples.

    Raises
    ------
    ConfigError
        If its outputs are not finite.
    """
    labels = labels_of(samples.base_from_hand, model.loss.size)
    found = model.labels(samples.inputs)
    errors = Errors.of(model.loss, torch.from_numpy(labels), torch.from_numpy(found))
    angles = angle_between(samples.base_from_hand[:, :3, :3], poses_of_labels(found)[:, :3, :3])
    total = float(errors.total(weights).mean())
    return Measured(total, float(errors.position.mean()), float(errors.rotation.mean()), float(angles.mean()))


@dataclass
class _State:
    """Where a run is."""

    iteration: int = 0
    seconds: float = 0.0
    best: float = float("inf")
    stale: int = 0
    stopped: str = ""


class _Run:
    """One training run in its folder."""

    def __init__(self, model: PoseModel, samples: Samples, split: Split, config: TrainConfig, folder: Path) -> None:
        self.model, self.config, self.folder = model, config, folder
        self.train, self.validation = samples[split.train], samples[split.validation]
        self.labels = torch.from_numpy(labels_of(self.train.base_from_hand, model.loss.size))
        self.optimizer = config.make(model)
        self.state = _State()
        self.batch = min(config.batch_size, len(self.train))
        self.per_epoch = len(self.train) // self.batch

    def restore(self) -> None:
        """Continue from the checkpoint, if there is one, and forget what was logged after it."""
        path = self.folder / "checkpoint.pt"
        if path.is_file():
            saved = torch.load(path, map_location="cpu", weights_only=True)
            self.model.load_state_dict(saved["model"])
            self.optimizer.load_state_dict(saved["optimizer"])
            self.state = _State(**saved["state"])
        for name, columns in (("iterations", _ITERATION), ("validations", _VALIDATION)):
            _cut(self.folder / f"{name}.csv", columns, self.state.iteration)

    def checkpoint(self) -> None:
        """Write all that the run continues from."""
        saved = {"model": self.model.state_dict(), "optimizer": self.optimizer.state_dict()}
        with replacing(self.folder / "checkpoint.pt") as path:
            torch.save({**saved, "state": asdict(self.state)}, path)

    def step(self) -> tuple[float, ...]:
        """Take one iteration; gives a row of ``iterations.csv``."""
        started, state = time.monotonic(), self.state
        epoch, place = divmod(state.iteration, self.per_epoch)
        order = np.random.default_rng([self.config.seed, epoch]).permutation(len(self.train))
        rows = np.sort(order[place * self.batch : (place + 1) * self.batch])
        # Dropout.
        torch.manual_seed(int(np.random.SeedSequence([self.config.seed, state.iteration]).generate_state(1)[0]))
        self.model.train()
        outputs = self.model(torch.from_numpy(self.train.inputs[rows]))
        errors = Errors.of(self.model.loss, self.labels[rows], outputs)
        totals = errors.total(self.config.weights)
        loss = totals.sum() if self.config.reduction == "sum" else totals.mean()
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()
        state.iteration += 1
        state.seconds += time.monotonic() - started
        norm = float(torch.linalg.vector_norm(outputs.detach()[:, 3:], dim=1).mean())
        means = (float(part.detach().mean()) for part in (totals, errors.position, errors.rotation))
        return (state.iteration, epoch, round(state.seconds, 3), *means, norm)

    def validate(self) -> tuple[float, ...]:
        """Measure the validation samples, and keep the model if it is the best so far; gives a row of its log."""
        started, state = time.monotonic(), self.state
        found = measure(self.model, self.validation, self.config.weights)
        if found.loss < _IMPROVED * state.best:
            state.best, state.stale = found.loss, 0
            self.model.save(self.folder)
        else:
            state.stale += 1
        if state.stale >= self.config.patience:
            state.stopped = "patience"
        elif state.iteration >= self.config.max_epochs * self.per_epoch:
            state.stopped = "max_epochs"
        state.seconds += time.monotonic() - started
        epoch = (state.iteration - 1) // self.per_epoch
        return (state.iteration, epoch, round(state.seconds, 3), *asdict(found).values())


def train(
    model_config: ModelConfig,
    samples: Samples,
    split: Split,
    config: TrainConfig,
    folder: Path,
    *,
    minutes: float | None = None,
    iterations: int | None = None,
    resume: bool = False,
    checkpoint_minutes: float = 5.0,
    done: Callable[[int, dict[str, float]], None] = lambda *_: None,
) -> PoseModel:
    """Train a network until its validation error stops falling, or its time is up.

    Parameters
    ----------
    model_config : ModelConfig
        The network.
    samples : Samples
        Inputs and poses.
    split : Split
        Which samples train it, and which decide when to stop.
    config : TrainConfig
        How to train.
    folder : Path
        Folder of the run; see `graspbox.learning.training`.
    minutes : float, optional
        Wall time after which it stops; what it spent before an interruption counts.
    iterations : int, optional
        Iterations after which it stops.
    resume : bool
        Continue a run, or give the model of one that is complete.
    checkpoint_minutes : float
        Time between two checkpoints.
    done : callable
        Called after each iteration with its number and the row of the log.

    Returns
    -------
    PoseModel
        The model with the least validation error.

    Raises
    ------
    ConfigError
        If the folder holds a run and `resume` is False, if its settings are others, or if the training diverges.
    FileError
        If a file cannot be written.
    """
    settings = {"model": asdict(model_config), "training": asdict(config), "samples": len(samples)}
    settings |= {"minutes": minutes, "iterations": iterations}
    _begin(folder, json.loads(json.dumps(settings)), resume)
    if (folder / "result.json").is_file():
        return PoseModel.load(folder)
    model = PoseModel(model_config, config.seed)
    run = _Run(model, samples, split, config, folder)
    if config.fit_scaling:
        model.fit_scaling(run.train.inputs, run.labels.numpy())
    run.restore()
    _loop(run, minutes, iterations, checkpoint_minutes, done)
    # A run that is complete does not continue, and a checkpoint takes up to three times the space of the weights.
    write_text(folder / "result.json", json.dumps(asdict(run.state), indent=2) + "\n")
    (folder / "checkpoint.pt").unlink(missing_ok=True)
    return PoseModel.load(folder)


def _begin(folder: Path, settings: dict[str, Any], resume: bool) -> None:
    """Write the settings of a run, or compare them with those that it was begun with."""
    path = folder / "run.json"
    if not path.is_file():
        write_text(path, json.dumps(settings, indent=2) + "\n")
        return
    if not resume:
        raise ConfigError(f"{str(folder)!r} holds a run; continue it with resume, or name another folder")
    known = json.loads(path.read_text())
    if known != settings:
        changed = ", ".join(key for key in {**known, **settings} if known.get(key) != settings.get(key))
        raise ConfigError(f"the run in {str(folder)!r} was begun with other settings ({changed}); name another folder")


def _loop(
    run: _Run,
    minutes: float | None,
    iterations: int | None,
    checkpoint_minutes: float,
    done: Callable[[int, dict[str, float]], None],
) -> None:
    state = run.state
    saved = state.seconds
    with (
        (run.folder / "iterations.csv").open("a", newline="") as steps,
        (run.folder / "validations.csv").open("a", newline="") as tests,
        SummaryWriter(str(run.folder / "tensorboard"), purge_step=state.iteration + 1) as board,
    ):
        while not state.stopped:
            row = run.step()
            csv.writer(steps).writerow(row)
            _show(board, "train", _ITERATION, row)
            if not np.isfinite(row[3]):
                raise ConfigError(f"the training in {str(run.folder)!r} diverged; give a smaller learning_rate")
            if (minutes is not None and state.seconds >= 60 * minutes) or state.iteration == iterations:
                state.stopped = "budget"
            if state.stopped or state.iteration % run.per_epoch == 0:
                stopped, test = state.stopped, run.validate()
                state.stopped = stopped or state.stopped
                csv.writer(tests).writerow(test)
                _show(board, "validation", _VALIDATION, test)
            if not state.stopped and state.seconds - saved >= 60 * checkpoint_minutes:
                saved = state.seconds
                steps.flush()
                tests.flush()
                run.checkpoint()
            done(state.iteration, dict(zip(_ITERATION, row, strict=True)))


def _show(board: SummaryWriter, part: str, columns: tuple[str, ...], row: tuple[float, ...]) -> None:
    for name, value in zip(columns[3:], row[3:], strict=True):
        board.add_scalar(f"{part}/{name}", value, int(row[0]))


def _cut(path: Path, columns: tuple[str, ...], iteration: int) -> None:
    """Keep the rows of a log up to an iteration; a log that does not exist yet gets its header."""
    rows: list[list[str]] = []
    if path.is_file():
        with path.open(newline="") as file:
            # A line that was cut off by an interruption lies after the checkpoint, or has too few cells.
            rows = [row for row in list(csv.reader(file))[1:] if len(row) == len(columns) and int(row[0]) <= iteration]
    with replacing(path) as temporary, temporary.open("w", newline="") as file:
        csv.writer(file).writerows([columns, *rows])
