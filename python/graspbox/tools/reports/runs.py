"""Runs of any kind as a report uses them: trials in columns, counts, curves, facts, replays."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSpec

#: Measures of trainings that are shares of 1.
SHARES = ("success on held-out objects", "secure grasps on held-out objects", "rollout/success_rate")
#: Greatest number of trials of a run.
MAX_TRIALS = 2_000_000


@dataclass(frozen=True)
class Counts:
    """Numbers of trials, successes, secure grasps (None if unknown), and failures by kind (empty if unknown)."""

    trials: int
    succeeded: int
    secure: int | None = None
    failures: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= (self.secure or 0) <= self.trials or not 0 <= self.succeeded <= self.trials:
            raise ConfigError(
                f"{self.succeeded} successes and {self.secure} secure grasps of {self.trials} trials do not fit "
                "together; make the run again, or leave it out"
            )


def pooled(members: Sequence[Counts]) -> Counts:
    """Add counts."""
    failures = sum((Counter(counts.failures) for counts in members), Counter())
    secure = None if any(c.secure is None for c in members) else sum(c.secure or 0 for c in members)
    return Counts(sum(c.trials for c in members), sum(c.succeeded for c in members), secure, dict(failures))


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials of a run; columns of length n."""

    #: The same trial of another run has the same key.
    keys: tuple[str, ...]
    #: Names.
    objects: tuple[str, ...]
    success: NDArray[np.bool_]
    secure: NDArray[np.bool_]
    #: Kind of the failure; empty for a success, and if unknown.
    failure: tuple[str, ...]
    #: Predicted probability of success; NaN where there is none.
    probability: NDArray[np.float64]

    def __post_init__(self) -> None:
        lengths = {len(column) for column in vars(self).values()}
        if len(lengths) > 1:
            raise ConfigError(
                f"columns of trials have {sorted(lengths)} rows; they must have the same number; make the run again"
            )
        if len(self) > MAX_TRIALS:
            raise ConfigError(f"it has {len(self)} trials; a report reads at most {MAX_TRIALS}")
        stated = self.probability[~np.isnan(self.probability)]
        if ((stated < 0) | (stated > 1)).any():
            low, high = stated.min(), stated.max()
            raise ConfigError(f"predicted probabilities are {low} to {high}, not within 0 to 1; make the run again")

    def __len__(self) -> int:
        return len(self.keys)

    def counts(self, rows: Sequence[int] | None = None) -> Counts:
        """Count the trials of some rows, by default of all."""
        chosen = range(len(self)) if rows is None else rows
        kinds = Counter(self.failure[i] for i in chosen if not self.success[i] and self.failure[i])
        won, secure = int(self.success[chosen].sum()), int(self.secure[chosen].sum())
        return Counts(len(chosen), won, secure, dict(sorted(kinds.items())))

    def by_object(self) -> dict[str, Counts]:
        """Count the trials of each object, in alphabetical order."""
        rows: dict[str, list[int]] = {}
        for i, name in enumerate(self.objects):
            rows.setdefault(name, []).append(i)
        return {name: self.counts(rows[name]) for name in sorted(rows)}


@dataclass(frozen=True)
class TrainingCurve:
    """A measure of a training over its steps."""

    training: str
    measure: str
    steps: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Picture:
    """A failed trial that can be shown: its object, kind of failure and description.

    `render` repeats the trial and renders it: pictures (H, W, 3) from left to right, and the kind of failure of the
    repetition (empty for a success).
    """

    object: str
    failure: str
    trial: str
    render: Callable[[], tuple[list[NDArray[np.uint8]], str]]


@dataclass(frozen=True, eq=False)
class ReportRun:
    """One run.

    Attributes
    ----------
    name, kind : str
        Name in tables and legends; ``evaluation``, ``grasps``, ``data set`` or ``training``.
    path : str
        The file or folder.
    facts : mapping
        Facts in its files: commands, versions, dates, settings.
    total : Counts or None
        Counts of all trials; None for a training.
    objects : mapping
        Counts of each object.
    trials : Trials or None
        Its trials, where its files have them.
    specs : mapping
        The objects by name, where they are on this machine.
    curves, pictures : tuple
        Curves of a training; failures that can be shown.
    refused : mapping
        Why objects could not be used.
    """

    name: str
    kind: str
    path: str
    facts: Mapping[str, str]
    total: Counts | None = None
    objects: Mapping[str, Counts] = field(default_factory=dict)
    trials: Trials | None = None
    specs: Mapping[str, ObjectSpec] = field(default_factory=dict)
    curves: tuple[TrainingCurve, ...] = ()
    pictures: tuple[Picture, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
