"""Settings of a training; without torch."""

from dataclasses import dataclass
from typing import Literal, get_args

from graspbox.errors import ConfigError

__all__ = ["OPTIMIZERS", "SCHEDULES", "Optimizer", "Schedule", "TrainConfig"]

Optimizer = Literal["adamw", "adam", "fused_adam", "sgd", "momentum", "nesterov", "adagrad", "delta_bar_delta"]
Schedule = Literal["warmup_cosine", "epoch_cosine", "constant"]
OPTIMIZERS, SCHEDULES = get_args(Optimizer), get_args(Schedule)


@dataclass(frozen=True)
class TrainConfig:
    """How a network is trained.

    Attributes
    ----------
    optimizer : str
        One of `OPTIMIZERS`. ``fused_adam`` takes one pass over all weights, which is faster for large networks and
        rounds differently; ``momentum`` and ``nesterov`` are SGD; ``delta_bar_delta`` is torch's ``Rprop``, which
        adapts each weight's step by the sign of its gradient only.
    schedule : str
        One of `SCHEDULES`. ``warmup_cosine``: the learning rate rises over the first 2 % and falls to 0 along half a
        cosine, which ends with the steps or the time, whichever comes first. ``epoch_cosine``: it falls along
        half a cosine over the steps, only at validations. ``constant``: no decay.
    learning_rate : float
        Greatest learning rate; of ``delta_bar_delta`` the first step of each weight.
    weight_decay, momentum : float
        Of ``adamw``; of ``momentum`` and ``nesterov``.
    clip_norm : float or None
        Greatest norm of the gradient; None disables clipping.
    validate_every : int
        Steps between validations, each of which writes a checkpoint.
    log_every : int or None
        Steps between rows of the log; None for rows at validations only.
    patience : int
        Validations without improvement after which training stops.
    improvement : float
        A measure is better if it exceeds the best by more than this share of its size.
    keep : {"best", "last"}
        Which weights are the result: those of the best validation, or the last ones.
    max_seconds : float
        Seconds of training, including those before interruptions, after which it stops.
    seed : int
        Seed of weights and batches.
    device : str
        Device, as torch names it: ``cpu``, ``cuda``, ``cuda:1``. Results are bit-identical only on the same device.
    """

    optimizer: Optimizer = "adamw"
    schedule: Schedule = "warmup_cosine"
    learning_rate: float = 2e-3
    weight_decay: float = 1e-4
    momentum: float = 0.5
    clip_norm: float | None = 10.0
    batch_size: int = 16
    max_steps: int = 20_000
    validate_every: int = 500
    log_every: int | None = None
    patience: int = 10
    improvement: float = 0.0
    keep: Literal["best", "last"] = "best"
    max_seconds: float = 7200.0
    seed: int = 0
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, known in (("optimizer", OPTIMIZERS), ("schedule", SCHEDULES), ("keep", ("best", "last"))):
            if getattr(self, name) not in known:
                raise ConfigError(f"{name} is {getattr(self, name)!r}; choose from {', '.join(known)}")
        for name, most in (("learning_rate", 1e30), ("clip_norm", 1e30), ("max_seconds", float("inf"))):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= most:
                raise ConfigError(f"{name} is {value}; it must be positive")
        if not 0.0 <= self.momentum < 1.0:
            raise ConfigError(f"momentum is {self.momentum}; it must be in [0, 1)")
        for name in ("weight_decay", "improvement"):
            if not getattr(self, name) >= 0.0:
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be 0 or more")
        for name in ("batch_size", "max_steps", "validate_every", "log_every", "patience"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ConfigError(f"{name} is {value}; it must be 1 or more")
