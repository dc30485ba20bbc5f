"""Options of ``graspbox train study``."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.learn.training.options import HandOption, Options
from graspbox.study.samples import Mapping

__all__ = ["StudySettings"]


@dataclass(frozen=True, kw_only=True)
class StudySettings(HandOption):
    """Retrain the reference study's networks, with its settings and with sane ones, and execute their poses.

        graspbox train study --out out/study --minutes-per-network 20
        graspbox train study --out out/quick --networks cnn3d --losses psi4 --iterations 200
        graspbox train study --out out/study --minutes-per-network 20 --publish policies/study

    The folder has study.md, which shows tables 3.2 and 3.3 next to ours and figures 3.19 to 3.27; results.jsonl with a
    row per network; data with the samples; and a folder per network (graspbox.study.training), which
    graspbox.study.regressor.PoseRegressor loads as a policy.

    The same command resumes an interrupted run: samples are kept, complete networks are not trained again, and an
    incomplete one resumes from its last checkpoint. Networks that end by --minutes-per-network depend on
    the speed of the machine; those that end by --iterations or by early stopping do not.

    --publish exports the best of the networks that are small enough, with a card, for onnxruntime; Cnn2d has 190 MB.
    Needs the extras cli, ycb and train.
    """

    free: ClassVar[tuple[str, ...]] = (*Options.free, "minutes_per_network", "publish", "measured", "trials")

    torch_threads: int = 2
    """CPU threads of the networks; another number rounds differently."""
    settings: Literal["legacy", "sane", "both"] = "both"
    """The study's settings, sane ones under which its networks learn, or both."""
    networks: tuple[Literal["cnn2d", "cnn2d_dropout", "cnn3d"], ...] = ("cnn2d", "cnn2d_dropout", "cnn3d")
    """Networks to train."""
    losses: tuple[Literal["posenet", "psi1", "psi2", "psi3", "psi4", "euler"], ...] = ("psi4", "psi3", "psi2", "euler")
    """Losses to train each network with; by default those of the study's tables."""
    mapping: Mapping = "many_to_one"
    """Pairing of views and poses; the study chose many_to_one."""
    voxels: Literal["binary", "ternary"] = "ternary"
    """Voxels of the 3D network."""
    objects: tuple[str, ...] = ()
    """Object sets; by default the study's ten objects of the YCB set."""
    samples: int | None = None
    """Number of samples; by default those of the study, 1,230 images and 189 grids."""
    units: Literal["relu", "sigmoid"] = "relu"
    """Units of the networks."""
    optimizer: Literal["sgd", "momentum", "nesterov", "adagrad", "adam", "delta_bar_delta"] | None = None
    """Optimizer; overrides the settings."""
    learning_rate: float | None = None
    """Learning rate; overrides the settings."""
    minutes_per_network: float | None = None
    """Time limit of each network, wall time; by default only early stopping ends it."""
    iterations: int | None = None
    """Greatest number of iterations of each network."""
    publish: Path | None = None
    """Folder of the best small network as a policy."""
    measured: tuple[str, ...] = ("procedural:unseen:0-19", "ycb/test")
    """Object sets for the evaluation of that policy; /SPLIT keeps one split."""
    trials: int = 1000
    """Trials per object set."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.hand not in Hand.names():
            known = ", ".join(Hand.names())
            raise ConfigError(f"--hand is {self.hand!r}; a published policy names its hand: choose from {known}")
        self._at_least(samples=20, iterations=1, trials=1)
        self._positive("minutes_per_network", "learning_rate")
        for name in ("networks", "losses"):
            if not getattr(self, name) or len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ConfigError(f"--{name} is {' '.join(getattr(self, name))!r}; name each once, one or more")
