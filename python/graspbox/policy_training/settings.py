"""Settings of the training of a policy of one depth image."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError

__all__ = ["QUICK", "QUICK_OBJECTS", "Hours", "Settings", "Sizes"]


@dataclass(frozen=True)
class Hours:
    """Time limits of the stages, hours."""

    data: float = 3.0
    completion: float = 1.75
    scorer: float = 0.6
    head: float = 0.9
    collect: float = 0.3
    """Of each round."""
    round: float = 0.35
    """Of each round."""
    member: float = 1.0
    """Of each further member of the ensemble."""
    calibrate: float = 0.2
    """Of all calibrations."""
    evaluate: float = 0.7


@dataclass(frozen=True)
class Sizes:
    """How much is made and learned at most; ``--quick`` makes all of them small."""

    poses: int = 128
    """Trials per scene of the data set."""
    rests: int = 2
    """Scenes per object of the data set."""
    completion_steps: int = 12_000
    scorer_steps: int = 15_000
    head_steps: int = 4_000
    round_steps: int = 6_000
    batch: int = 256
    completion_batch: int = 16
    completion_width: int = 16
    """Channels of the completion's first layer."""
    width: int = 48
    """Channels of the scorer's first layer."""
    rounds: int = 6
    members: int = 1
    """Scorers of the ensemble."""
    refinements: tuple[int, ...] = (0,)
    """Counts of refinements that the calibration tries; the policy refines as often as is best for held-out objects."""
    scenes: int = 4_000
    """Scenes of each round."""
    held_out_scenes: int = 150
    """Scenes of each round that validate."""
    choices: int = 1_500
    """Scenes that calibrate."""
    trials: int = 1_000
    """Trials of each set of objects in the evaluation."""
    validate_every: int = 250

    def __post_init__(self) -> None:
        if self.members < 1:
            raise ConfigError(f"--sizes.members is {self.members}; give 1 or more")
        if not self.refinements or min(self.refinements) < 0:
            raise ConfigError(f"--sizes.refinements is {self.refinements}; give one count or more, each 0 or more")


#: What ``--quick`` makes.
QUICK = Sizes(
    poses=16,
    rests=1,
    completion_steps=6,
    scorer_steps=12,
    head_steps=6,
    round_steps=6,
    batch=32,
    completion_batch=4,
    completion_width=4,
    width=8,
    rounds=3,
    members=3,
    refinements=(0, 2),
    scenes=4,
    held_out_scenes=2,
    choices=6,
    trials=6,
    validate_every=6,
)
#: Its objects.
QUICK_OBJECTS: dict[str, Any] = {
    "objects": ("procedural:can:0-9",),
    "fresh": ("procedural:can:10-29",),
    "evaluated": ("procedural:bottle:30-33",),
}


@dataclass(frozen=True)
class Settings:
    """Arguments of a training."""

    out: Path
    """Folder of the run."""
    data: tuple[Path, ...] = ()
    """Data sets of trials that exist; without them one is made in the run's folder."""
    objects: tuple[str, ...] = (
        "procedural:seen:0-199",
        "procedural:prism:200-799",
        "procedural:bracket:200-799",
        "procedural:carton:200-799",
        "ycb",
    )
    """Objects of the data set that is made, and of the completion."""
    fresh: tuple[str, ...] = (
        "procedural:seen:200-399",
        "procedural:prism:1000-1799",
        "procedural:bracket:1000-1799",
        "procedural:carton:1000-1799",
    )
    """Objects of the rounds (split train), and of validation and calibration (split validation)."""
    evaluated: tuple[str, ...] = ("procedural:unseen:0-19", "ycb")
    """Objects of the evaluation; of sets other than unseen families only the split test."""
    publish: Path | None = None
    """Folder of the exported policy; by default ``policy`` in the run's folder."""
    name: str = "depth"
    """Name of the policy."""
    seed: int = 0
    quick: bool = False
    """Go through all stages in minutes."""
    hours: Hours = field(default_factory=Hours)
    sizes: Sizes = field(default_factory=Sizes)
