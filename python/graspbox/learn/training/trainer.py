"""The loop that trains every network: completion, scorer, heads, grasp stability, the study's networks, clones.

A training has a run directory (`graspbox._common.runs`):

| file | contents |
|---|---|
| ``settings.json`` | its `TrainConfig`, and other settings that determine the weights |
| ``losses.jsonl``  | rows: step, seconds, mean training losses since the last row; at validations their measures too |
| ``tensorboard/``  | the same for TensorBoard |
| ``weights.pt``    | the weights kept: those with the best validation measure so far, or the last ones |
| ``checkpoint.pt`` | network, optimizer and random numbers at the last validation, from which it continues |
| ``results.json``  | how it ended; without a checkpoint, the training is not continued |

The loop is our own. PyTorch Ignite 0.5.5 and Lightning Fabric 2.6.6 were tried with the same contract, and end with the
same bits after an interruption too, once random numbers are added to their checkpoints. They take 90 and 89 lines of
code where this takes about 100, since batches by number, the learning rate by the share of steps or time, early
stopping, the best weights and the log stay ours; they add 2 and 5 seconds to the start of a command, and 1 and 9
packages.

The batch of a step depends only on its number, and random numbers of the network, as of dropout, are part of the
checkpoint: a training that was interrupted ends with the bits of one that was not, on the same device with the same
number of threads.
"""

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter

from graspbox._common.files import dumps, replacing, write_text
from graspbox._common.runs import Rows, Run
from graspbox.errors import ConfigError
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.norms import fold_norms

__all__ = [
    "TrainConfig",
    "TrainProgress",
    "Trained",
    "Trainer",
    "device_of",
    "load_weights",
    "moved",
    "read_weights",
    "save_atomic",
]

Batch = TypeVar("Batch")
#: Share of the training in which the learning rate of ``warmup_cosine`` rises to its greatest value.
_WARM_UP = 0.02
#: Settings that a later call may change: more time or patience continues a training.
_EXTENDED = ("max_seconds", "patience", "device")


@dataclass(frozen=True)
class TrainProgress:
    """Progress of a training: steps, seconds including earlier runs, and losses of the last step by name.

    `share` is the fraction of the steps or of the time that is used, whichever is more; `best` the best validation
    measure so far, minus infinity before the first.
    """

    step: int
    seconds: float
    share: float
    best: float
    losses: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Trained:
    """How a training ended: by ``steps``, ``patience`` or ``time``; with the best validation measure."""

    reason: str
    step: int
    seconds: float
    best: float


class Trainer(Generic[Batch]):
    """Trains a network in a folder, or continues there.

    Parameters
    ----------
    net : Module
        The network, made from the seed of the configuration. It moves to the device, and remains there with the
        weights kept.
    batch : callable
        Returns the batch of a step, from only its number; called in another thread, one step ahead, so that it must not
        use torch's global random numbers. Tensors in it move to the device.
    losses : callable
        Returns losses of a batch by name. The sum of those with a gradient is minimized; the others are only logged.
    validate : callable
        Returns validation measures by name; the first decides, and greater is better.
    settings : mapping
        Other settings that determine the weights, as JSON holds them; a folder with different ones is refused.
    parameters : iterable of Parameter, optional
        The weights to train; by default all of the network.
    trained : bool
        The initial weights are of a trained network: they are validated too, and kept where no later ones are better.
    """

    def __init__(
        self,
        net: nn.Module,
        folder: Path,
        config: TrainConfig,
        *,
        batch: Callable[[int], Batch],
        losses: Callable[[nn.Module, Batch], Mapping[str, Tensor]],
        validate: Callable[[nn.Module], Mapping[str, float]],
        settings: Mapping[str, Any] | None = None,
        parameters: Iterable[nn.Parameter] | None = None,
        trained: bool = False,
    ) -> None:
        self._net, self._folder, self._config = net.to(config.device), Path(folder), config
        self._batch, self._losses, self._validate, self._trained = batch, losses, validate, trained
        kept = {name: value for name, value in asdict(config).items() if name not in _EXTENDED}
        self._settings = {**kept, **(settings or {})}
        self._optimizer = _optimizer(config, net.parameters() if parameters is None else parameters)
        self._step, self._seconds, self._best, self._since = 0, 0.0, -float("inf"), 0
        self._started = 0.0

    def run(self, progress: Callable[[TrainProgress], None] = lambda _: None) -> Trained:
        """Train until a limit is reached; `progress` is called after each step.

        Raises ConfigError if the folder holds a training with other settings, or the loss is not finite.
        """
        results = self._folder / "results.json"
        with Run(self._folder, self._settings) as run:
            if results.exists() and not (self._folder / "checkpoint.pt").exists():
                load_weights(self._net, self._folder / "weights.pt")
                return Trained(**json.loads(results.read_text()))
            rows = run.rows("losses")
            self._restore(rows)
            reason = self._reason()
            with (
                ThreadPoolExecutor(1) as ahead,
                SummaryWriter(str(self._folder / "tensorboard"), purge_step=self._step + 1) as board,
            ):
                if not reason:
                    reason = self._loop(ahead, _Log(rows, board), progress)
            trained = Trained(reason, self._step, self._seconds, self._best)
            write_text(results, dumps(asdict(trained)) + "\n")
        load_weights(self._net, self._folder / "weights.pt")
        return trained

    def _loop(self, ahead: ThreadPoolExecutor, log: "_Log", progress: Callable[[TrainProgress], None]) -> str:
        """Train until a limit is reached; returns its name."""
        config, reason, self._started = self._config, "", time.monotonic() - self._seconds
        coming = ahead.submit(self._batch, self._step)
        if self._trained and self._best == -float("inf"):
            log.write(0, 0.0, self._check())
        while not reason:
            batch = moved(coming.result(), config.device)
            if self._step + 1 < config.max_steps:
                coming = ahead.submit(self._batch, self._step + 1)
            losses = self._learn(batch)
            self._step += 1
            self._seconds = time.monotonic() - self._started
            log.add(losses)
            late = self._seconds >= config.max_seconds
            if self._step % config.validate_every == 0 or self._step == config.max_steps or late:
                measures = self._check()
                log.write(self._step, self._seconds, measures)
                reason = self._reason()
            elif config.log_every is not None and self._step % config.log_every == 0:
                log.write(self._step, self._seconds, {})
            progress(TrainProgress(self._step, self._seconds, self._share(), self._best, losses))
        return reason

    def _restore(self, rows: Rows) -> None:
        """Continue from the checkpoint, if any, discarding rows logged after it."""
        path = self._folder / "checkpoint.pt"
        if path.exists():
            saved = torch.load(path, map_location=self._config.device, weights_only=True)
            self._net.load_state_dict(saved["net"])
            self._optimizer.load_state_dict(saved["optimizer"])
            _set_random(saved["random"], self._config.device)
            self._step, self._seconds, self._best, self._since = (saved[name] for name in _STATE)
        rows.keep(lambda row: row["step"] <= self._step)

    def _reason(self) -> str:
        """Return why training stops here; empty if it does not."""
        config = self._config
        if self._step >= config.max_steps:
            return "steps"
        if self._since >= config.patience:
            return "patience"
        return "time" if self._seconds >= config.max_seconds else ""

    def _share(self) -> float:
        """Return the fraction of the budget used: of the steps or of the time, whichever is more."""
        config = self._config
        return float(min(1.0, max(self._step / config.max_steps, self._seconds / config.max_seconds)))

    def _rate(self) -> float:
        """Return the learning rate of the next step, as a share of its greatest value."""
        config, step, share = self._config, self._step, self._share()
        if config.schedule == "constant":
            return 1.0
        if config.schedule == "epoch_cosine":
            share = step // config.validate_every * config.validate_every / config.max_steps
            return 0.5 * (1.0 + math.cos(math.pi * share))
        rising = min(1.0, max((step + 1) / config.max_steps, share) / _WARM_UP)
        return rising * (0.5 * (1.0 + math.cos(math.pi * share)))

    def _learn(self, batch: Batch) -> dict[str, float]:
        """Take one step."""
        config = self._config
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * self._rate()
        self._net.train()
        losses = self._losses(self._net, batch)
        total = torch.stack([loss for loss in losses.values() if loss.requires_grad]).sum()
        if not torch.isfinite(total):
            raise ConfigError(f"the loss of step {self._step} is {float(total.detach())}; lower learning_rate")
        self._optimizer.zero_grad(set_to_none=True)
        total.backward()
        if config.clip_norm is not None:
            nn.utils.clip_grad_norm_(self._net.parameters(), config.clip_norm)
        self._optimizer.step()
        return {name: float(loss.detach()) for name, loss in losses.items()}

    def _check(self) -> dict[str, float]:
        """Validate, keep the best weights, and save a checkpoint; returns the measures."""
        config = self._config
        self._net.eval()
        with torch.no_grad():
            measures = dict(self._validate(self._net))
        self._seconds = time.monotonic() - self._started
        wrong = next((f"{name} is {value}" for name, value in measures.items() if not math.isfinite(value)), None)
        if wrong is not None:
            raise ConfigError(f"in the validation of step {self._step}, {wrong}; lower learning_rate")
        measure, least = next(iter(measures.values())), self._best
        if least > -float("inf"):
            least += config.improvement * abs(least)
        if better := measure > least:
            self._best, self._since = measure, 0
        else:
            self._since += 1
        if better or config.keep == "last":
            save_atomic(self._net.state_dict(), self._folder / "weights.pt")
        saved = {"net": self._net.state_dict(), "optimizer": self._optimizer.state_dict()}
        saved |= {"random": _random(config.device)}
        saved |= dict(zip(_STATE, (self._step, self._seconds, self._best, self._since), strict=True))
        save_atomic(saved, self._folder / "checkpoint.pt")
        return measures


#: State of a training, as named in its checkpoint.
_STATE = ("step", "seconds", "best", "since")


class _Log:
    """Rows of mean losses and of measures, in a file and for TensorBoard."""

    def __init__(self, rows: Rows, board: SummaryWriter) -> None:
        self._rows, self._board = rows, board
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, losses: Mapping[str, float]) -> None:
        self._count += 1
        for name, loss in losses.items():
            self._sums[name] = self._sums.get(name, 0.0) + loss

    def write(self, step: int, seconds: float, measures: Mapping[str, float]) -> None:
        values = {f"train_{name}": total / self._count for name, total in self._sums.items()} | dict(measures)
        self._rows.append({"step": step, "seconds": round(seconds, 3), **values})
        for name, value in values.items():
            self._board.add_scalar(name, value, step)
        self._sums, self._count = {}, 0


def _optimizer(config: TrainConfig, weights: Iterable[nn.Parameter]) -> torch.optim.Optimizer:
    """Make an optimizer by its name."""
    rate = config.learning_rate
    if config.optimizer == "adamw":
        return torch.optim.AdamW(weights, rate, weight_decay=config.weight_decay)
    if config.optimizer in ("adam", "fused_adam"):
        return torch.optim.Adam(weights, rate, fused=True if config.optimizer == "fused_adam" else None)
    if config.optimizer == "adagrad":
        return torch.optim.Adagrad(weights, rate)
    if config.optimizer == "delta_bar_delta":
        return torch.optim.Rprop(weights, rate)
    momentum = 0.0 if config.optimizer == "sgd" else config.momentum
    return torch.optim.SGD(weights, rate, momentum=momentum, nesterov=config.optimizer == "nesterov")


def _random(device: str) -> dict[str, Tensor]:
    """Return the state of torch's random numbers."""
    state = {"cpu": torch.get_rng_state()}
    return state | {"cuda": torch.cuda.get_rng_state(device)} if device.startswith("cuda") else state


def _set_random(state: Mapping[str, Tensor], device: str) -> None:
    torch.set_rng_state(state["cpu"].cpu())
    if device.startswith("cuda") and "cuda" in state:
        torch.cuda.set_rng_state(state["cuda"].cpu(), device)


def moved(batch: Any, device: str | torch.device) -> Any:
    """Move the tensors of a batch to a device: a tensor, or a tuple, mapping or dataclass with tensors in it."""
    if isinstance(batch, Tensor):
        return batch.to(device)
    if isinstance(batch, tuple):
        return tuple(moved(one, device) for one in batch)
    if isinstance(batch, dict):
        return {name: moved(one, device) for name, one in batch.items()}
    if is_dataclass(batch) and not isinstance(batch, type):
        return replace(batch, **{f.name: moved(getattr(batch, f.name), device) for f in fields(batch)})
    return batch


def device_of(net: nn.Module) -> torch.device:
    """Return the device of a network; the CPU for one without weights."""
    first = next(net.parameters(), None)
    return torch.device("cpu") if first is None else first.device


def save_atomic(value: Any, path: Path) -> None:
    """Save a value with torch, whole or not at all."""
    with replacing(path) as temporary:
        torch.save(value, temporary)


def read_weights(path: Path) -> dict[str, Tensor]:
    """Read the weights of a network; raises ConfigError if there are none, or the file is not one of weights."""
    if not path.exists():
        raise ConfigError(f"there are no weights {path}; train the network first")
    try:
        weights: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, UnpicklingError) as error:
        raise ConfigError(f"{path} is not a file of weights: {error}") from None
    return weights


def load_weights(net: nn.Module, path: Path) -> None:
    """Load the weights of a network, and set it to evaluation; weights without norms fold those of the network.

    Raises ConfigError as `read_weights`, and if the weights belong to another network.
    """
    weights = read_weights(path)
    if net.state_dict().keys() != weights.keys():
        fold_norms(net)
    try:
        net.load_state_dict(weights)
    except RuntimeError as error:
        raise ConfigError(f"{path} holds the weights of another network; train this one in another folder") from error
    net.eval()
