"""Training of the networks of perception: one loop, with a log, early stopping, and checkpoints to continue from.

A run has a folder:

| file | contents |
|---|---|
| ``run.json``      | its settings |
| ``log.csv``       | a row per validation: step, seconds, mean training losses since the last, validation measures |
| ``weights.pt``    | the state of the network with the best validation measure so far |
| ``checkpoint.pt`` | what an interrupted run continues from |

The batch of a step follows from its number alone, so a run that was interrupted sees what it would have seen.
"""

import csv
import json
import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.files import replacing, write_text

__all__ = ["TrainConfig", "TrainProgress", "Trained", "Trainer", "load_weights", "save_atomic"]

Batch = TypeVar("Batch")
#: Share of the steps in which the learning rate rises to its greatest value.
_WARM_UP = 0.02


@dataclass(frozen=True)
class TrainConfig:
    """How a network is trained.

    Attributes
    ----------
    learning_rate : float
        Greatest learning rate of AdamW; it rises over the first steps and falls to 0 along a cosine, which ends with
        the steps or with the time, whichever comes first.
    weight_decay : float
        Of AdamW.
    batch_size : int
        Samples per step.
    max_steps : int
        Steps after which training stops.
    validate_every : int
        Steps between validations.
    patience : int
        Validations without a better measure after which training stops.
    max_seconds : float
        Seconds of training, those before interruptions included, after which it stops.
    seed : int
        Seed of the weights.
    """

    learning_rate: float = 2e-3
    weight_decay: float = 1e-4
    batch_size: int = 16
    max_steps: int = 20_000
    validate_every: int = 500
    patience: int = 10
    max_seconds: float = 7200.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("learning_rate", "max_seconds"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ConfigError(f"{name} is {getattr(self, name)}; give a positive number")
        if not self.weight_decay >= 0.0:
            raise ConfigError(f"weight_decay is {self.weight_decay}; give 0 or more")
        for name in ("batch_size", "max_steps", "validate_every", "patience"):
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}; give 1 or more")


@dataclass(frozen=True)
class TrainProgress:
    """How far a run is.

    Attributes
    ----------
    step : int
        Steps made.
    seconds : float
        Time that they took, with validations and those before interruptions.
    share : float
        What is over of the steps or of the time, whichever is more, 0 to 1.
    best : float
        Best validation measure so far; minus infinity before the first.
    """

    step: int
    seconds: float
    share: float
    best: float

    @property
    def remaining(self) -> float:
        """Expected time to the end, seconds; patience may end it before."""
        return self.seconds / self.share - self.seconds if self.share > 0 else float("inf")


@dataclass(frozen=True)
class Trained:
    """How a run ended.

    Attributes
    ----------
    reason : {"steps", "patience", "time"}
        Why it stopped.
    step : int
        Steps made.
    seconds : float
        Time that they took, with validations.
    best : float
        Best validation measure.
    """

    reason: str
    step: int
    seconds: float
    best: float


class Trainer(Generic[Batch]):
    """Trains a network in a folder.

    Parameters
    ----------
    net : Module
        The network. It is left with its best weights.
    folder : Path
        The run's folder; one that holds a checkpoint is continued.
    config : TrainConfig
        How it is trained.
    batch : callable
        Gives the batch of a step, from its number alone; called in another thread, one step ahead.
    losses : callable
        Gives the losses of a batch by name; their sum is minimized.
    validate : callable
        Gives validation measures by name; the first decides, and greater is better.
    """

    def __init__(
        self,
        net: nn.Module,
        folder: Path,
        config: TrainConfig,
        *,
        batch: Callable[[int], Batch],
        losses: Callable[[nn.Module, Batch], dict[str, Tensor]],
        validate: Callable[[nn.Module], Mapping[str, float]],
    ) -> None:
        self._net, self._folder, self._config = net, folder, config
        self._batch, self._losses, self._validate = batch, losses, validate
        self._optimizer = torch.optim.AdamW(net.parameters(), config.learning_rate, weight_decay=config.weight_decay)
        self._state: dict[str, Any] = {"step": 0, "seconds": 0.0, "best": -float("inf"), "since": 0, "reason": ""}

    def run(self, progress: Callable[[TrainProgress], None] | None = None) -> Trained:
        """Train until a limit is reached; `progress` is called after each step.

        Raises
        ------
        ConfigError
            If the folder is a run with other settings.
        """
        self._open()
        state, config = self._state, self._config
        started, means = time.monotonic() - state["seconds"], _Means()
        with ThreadPoolExecutor(1) as ahead:
            coming = None
            while not state["reason"]:
                batch = coming.result() if coming else self._batch(state["step"])
                coming = ahead.submit(self._batch, state["step"] + 1)
                means.add(self._step(batch))
                state["step"] += 1
                state["seconds"] = time.monotonic() - started
                late = state["seconds"] >= config.max_seconds
                if state["step"] % config.validate_every == 0 or state["step"] == config.max_steps or late:
                    self._check(means, late)
                    state["seconds"] = time.monotonic() - started
                    means = _Means()
                if progress is not None:
                    progress(TrainProgress(state["step"], state["seconds"], self._share(), state["best"]))
        self._net.load_state_dict(torch.load(self._folder / "weights.pt", weights_only=True))
        self._net.eval()
        return Trained(state["reason"], state["step"], state["seconds"], state["best"])

    def _open(self) -> None:
        """Make the folder, or continue the run in it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / "run.json"
        # More time or patience continues a run.
        settings = {k: v for k, v in asdict(self._config).items() if k not in ("max_seconds", "patience")}
        text = json.dumps(settings, indent=1) + "\n"
        if path.exists() and path.read_text() != text:
            raise ConfigError(f"{self._folder} holds a run with other settings; name another folder, or delete it")
        write_text(path, text)
        checkpoint = self._folder / "checkpoint.pt"
        if checkpoint.exists():
            saved = torch.load(checkpoint, weights_only=True)
            self._net.load_state_dict(saved["net"])
            self._optimizer.load_state_dict(saved["optimizer"])
            self._state = saved["state"]
            if self._state["since"] >= self._config.patience:
                self._state["reason"] = "patience"

    def _share(self) -> float:
        """Give what is over of the steps or of the time, whichever is more."""
        state, config = self._state, self._config
        return float(min(1.0, max(state["step"] / config.max_steps, state["seconds"] / config.max_seconds)))

    def _step(self, batch: Batch) -> dict[str, float]:
        config, step = self._config, self._state["step"]
        share = self._share()
        rate = min(1.0, max((step + 1) / config.max_steps, share) / _WARM_UP)
        rate *= 0.5 * (1.0 + math.cos(math.pi * share))
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * rate
        self._net.train()
        losses = self._losses(self._net, batch)
        total = torch.stack(list(losses.values())).sum()
        if not torch.isfinite(total):
            raise ConfigError(f"the loss of step {step} is {float(total)}; lower learning_rate")
        self._optimizer.zero_grad(set_to_none=True)
        total.backward()
        nn.utils.clip_grad_norm_(self._net.parameters(), 10.0)
        self._optimizer.step()
        return {name: float(loss.detach()) for name, loss in losses.items()}

    def _check(self, means: "_Means", late: bool) -> None:
        """Validate, log, keep what is best, and save a checkpoint."""
        state, config = self._state, self._config
        self._net.eval()
        with torch.no_grad():
            measures = dict(self._validate(self._net))
        measure = next(iter(measures.values()))
        if measure > state["best"]:
            state["best"], state["since"] = measure, 0
            save_atomic(self._net.state_dict(), self._folder / "weights.pt")
        else:
            state["since"] += 1
        if state["step"] >= config.max_steps:
            state["reason"] = "steps"
        elif state["since"] >= config.patience:
            state["reason"] = "patience"
        elif late:
            state["reason"] = "time"
        saved = {**state, "reason": "steps" if state["step"] >= config.max_steps else ""}
        self._log({"step": state["step"], "seconds": round(state["seconds"], 1), **means.values(), **measures})
        checkpoint = {"net": self._net.state_dict(), "optimizer": self._optimizer.state_dict(), "state": saved}
        save_atomic(checkpoint, self._folder / "checkpoint.pt")

    def _log(self, row: dict[str, float]) -> None:
        """Add a row; rows from after the checkpoint that was continued are dropped."""
        path = self._folder / "log.csv"
        rows = []
        if path.exists():
            with path.open(newline="") as file:
                rows = [old for old in csv.DictReader(file) if int(old["step"]) < row["step"]]
        with replacing(path) as temporary, open(temporary, "w", newline="") as file:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
            writer.writerows([*rows, row])


class _Means:
    """Means of losses by name."""

    def __init__(self) -> None:
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, losses: Mapping[str, float]) -> None:
        self._count += 1
        for name, loss in losses.items():
            self._sums[name] = self._sums.get(name, 0.0) + loss

    def values(self) -> dict[str, float]:
        return {f"train_{name}": total / self._count for name, total in self._sums.items()}


def save_atomic(value: Any, path: Path) -> None:
    """Save what torch can save, whole or not at all."""
    with replacing(path) as temporary:
        torch.save(value, temporary)


def load_weights(net: nn.Module, path: Path) -> None:
    """Load the weights of a network, and set it to evaluation.

    Raises
    ------
    ConfigError
        If there are none, or they are another network's.
    """
    if not path.exists():
        raise ConfigError(f"there are no weights {path}; train the network first")
    try:
        net.load_state_dict(torch.load(path, weights_only=True))
    except RuntimeError as error:
        raise ConfigError(f"{path} holds the weights of another network: {str(error).splitlines()[0]}") from error
    net.eval()
