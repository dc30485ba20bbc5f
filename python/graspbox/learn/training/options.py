"""Options shared by the commands of ``graspbox train``, and their results; without torch."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from graspbox._common.runs import Run
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand
from graspbox.hands.loading import hand_like

__all__ = ["HandOption", "Options", "TrainingOutcome"]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of every training."""

    out: Path
    """Folder of the run; a run in it that was interrupted, or is given more time, is continued."""
    resume: bool = True
    """Continue the run in the folder; with --no-resume the folder must not have one."""
    seed: int = 0
    """Seed of all random numbers."""
    device: str = "cpu"
    """Training device, as torch names it: cpu, cuda, cuda:1. Another device rounds differently."""
    torch_threads: int = 1
    """Threads of the networks on the CPU; another number rounds differently."""
    json: bool = False
    """Print the results as JSON, and nothing else, on standard output."""

    #: Options on which no result depends, or which a later call may change.
    free: ClassVar[tuple[str, ...]] = ("out", "resume", "device", "torch_threads", "json")
    #: Options that a later call may increase, and patterns of the stages that are then done again; see `Run`.
    growing: ClassVar[dict[str, tuple[str, ...]]] = {}

    def __post_init__(self) -> None:
        self._at_least(seed=0, torch_threads=1)

    def _at_least(self, **bounds: int) -> None:
        """Refuse numbers that are too small; None is accepted."""
        for name, least in bounds.items():
            value = getattr(self, name)
            if value is not None and value < least:
                raise ConfigError(f"--{name.replace('_', '-')} is {value}; pass {least} or more")

    def _positive(self, *names: str) -> None:
        """Refuse numbers that are not positive and finite; None is accepted."""
        for name in names:
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ConfigError(f"--{name.replace('_', '-')} is {value}; pass a positive number")

    def kept(self) -> dict[str, Any]:
        """Return the options on which the results depend, as JSON holds them."""
        values = {name: value for name, value in asdict(self).items() if name not in self.free}
        return dict(json.loads(json.dumps(values, default=str)))

    def run(self, echo: Callable[[str], None], settings: dict[str, Any] | None = None) -> Run:
        """Open the run of these options, or of other settings, in its folder."""
        kept = self.kept() if settings is None else settings
        return Run(self.out, kept, growing=self.growing, resume=self.resume, echo=echo)


@dataclass(frozen=True, kw_only=True)
class HandOption(Options):
    """Options of a training that simulates a hand of the user's choice."""

    hand: str = "reflex"
    """A hand by its name, or its two files with a comma between: hand.urdf,hand.toml."""

    @property
    def named_hand(self) -> str | tuple[str, str]:
        """The hand as environments take it: a name, or two files."""
        return hand_like(self.hand)

    def load_hand(self) -> Hand:
        """Load the hand."""
        return load_hand(self.named_hand)


@dataclass(frozen=True)
class TrainingOutcome:
    """The results of a command: those that ``--json`` prints, text for people, and the exit status.

    The status is 1 if the target was not reached, and 130 if the run was interrupted and saved.
    """

    results: Any
    text: str
    status: int = 0
