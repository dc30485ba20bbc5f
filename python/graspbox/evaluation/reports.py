"""Tables of several evaluations: policies and conditions side by side, rates by class of object."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from graspbox.errors import ConfigError
from graspbox.evaluation.conditions import CONDITIONS
from graspbox.evaluation.object_classes import CLASSES
from graspbox.evaluation.results import wilson
from graspbox.policies.published.calibration import calibration_error

__all__ = ["COLUMNS", "Measured", "class_table", "condition_table", "labels", "named", "policy_table", "pooled"]

#: Fields of `graspbox.evaluation.TrialResult` that the log stores per trial, in order.
COLUMNS = ("object", "success", "secure", "survives_shake", "confidence", "fits")
#: The policy whose successes bound the achievable ones.
_ORACLE = "robust_oracle"


@dataclass(frozen=True)
class Measured:
    """Trials of one policy on one set of objects under one condition.

    Attributes
    ----------
    condition, policy, objects : str
        The condition, a name in `CONDITIONS`; the policy (see `labels`); the object set.
    seed : int
        Seed of the trials.
    names, success, secure, survives_shake, confidence, fits : tuple
        For each trial its object and, as in `TrialResult`, its outcome, predicted probability, and whether it fits.
    milliseconds : float
        Wall time per decision.
    """

    condition: str
    policy: str
    objects: str
    seed: int
    names: tuple[str, ...]
    success: tuple[bool, ...]
    secure: tuple[bool, ...]
    survives_shake: tuple[bool, ...]
    confidence: tuple[float | None, ...]
    fits: tuple[bool, ...]
    milliseconds: float

    @classmethod
    def of(cls, row: Mapping[str, Any], policy: str) -> Self:
        """Read a row of the log of ``scripts/evaluate_policies.py``, with the label of its policy."""
        trials = [named(trial) for trial in row["trials"]]
        columns: dict[str, Any] = {name: tuple(trial[name] for trial in trials) for name in COLUMNS}
        others = {name: row[name] for name in ("condition", "objects", "seed", "milliseconds")}
        return cls(policy=policy, names=columns.pop("object"), **columns, **others)

    @property
    def calibration_error(self) -> float | None:
        """Expected calibration error; None if some trial has no predicted probability."""
        stated = [p for p in self.confidence if p is not None]
        return calibration_error(np.array(stated), np.array(self.success)) if len(stated) == len(self.success) else None

    @property
    def fitting_success(self) -> int:
        """Number of successes with objects that fit the hand."""
        return sum(success and fits for success, fits in zip(self.success, self.fits, strict=True))

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            **{name: getattr(self, name) for name in ("condition", "policy", "objects", "seed")},
            "trials": len(self.names),
            **{name: sum(getattr(self, name)) for name in ("success", "secure", "survives_shake")},
            "fitting": {"trials": sum(self.fits), "success": self.fitting_success},
            "calibration_error": self.calibration_error,
            "milliseconds": self.milliseconds,
        }


def named(trial: Sequence[Any]) -> dict[str, Any]:
    """Name the values of a trial in the log, `COLUMNS`; refuses another number of them."""
    if len(trial) != len(COLUMNS):
        raise ConfigError(f"a trial has {len(trial)} values instead of {len(COLUMNS)}; measure again")
    return dict(zip(COLUMNS, trial, strict=True))


def labels(policies: Sequence[str]) -> dict[str, str]:
    """Return a unique label for each policy.

    The label is KIND of ``KIND=FOLDER``, and the last part of a folder, or more of both if policies would share it.
    """
    labelled = dict.fromkeys(policies, "")
    for parts in (1, 2, None):
        texts = [policy if parts is None else _label(policy, parts) for policy in labelled]
        for policy, text in zip(labelled, texts, strict=True):
            labelled[policy] = labelled[policy] or (text if texts.count(text) == 1 else "")
    return labelled


def _label(policy: str, parts: int) -> str:
    kind, equals, path = policy.partition("=")
    if equals:
        return kind if parts == 1 else f"{kind} {Path(path).name}"
    return "/".join(Path(kind).parts[-parts:])


def pooled(rows: Sequence[Measured], *, by: Callable[[Measured], Any]) -> list[Measured]:
    """Merge rows with the same key `by`, such as those of several seeds, in their order."""
    groups: dict[Any, list[Measured]] = {}
    for row in rows:
        groups.setdefault(by(row), []).append(row)
    columns = ("names", *COLUMNS[1:])
    merged = []
    for group in groups.values():
        joined: dict[str, Any] = {name: sum((getattr(row, name) for row in group), ()) for name in columns}
        merged.append(replace(group[0], milliseconds=float(np.mean([row.milliseconds for row in group])), **joined))
    return merged


def _share(count: int, trials: int) -> str:
    """Format a rate with its Wilson interval."""
    low, high = wilson(count, trials)
    return f"{100 * count / trials:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def policy_table(rows: Sequence[Measured]) -> str:
    """Format policies under one condition: success, secure holds, calibration error, time per decision.

    Success with objects that fit the hand has its own column where some do not.
    """
    some = not all(all(row.fits) for row in rows)
    lines = [
        f"| policy | objects | trials | success | secure |{' success with objects that fit |' if some else ''} ECE "
        "| ms per decision |",
        f"|---|---|--:|--:|--:|{'--:|' if some else ''}--:|--:|",
    ]
    for row in pooled(rows, by=lambda r: (r.policy, r.objects)):
        trials, error = len(row.names), row.calibration_error
        shares = " | ".join(_share(sum(part), trials) for part in (row.success, row.secure))
        stated = "" if error is None else f"{error:.3f}"
        if some:
            stated = f"{_share(row.fitting_success, max(1, sum(row.fits)))} of {sum(row.fits)} | {stated}"
        lines.append(f"| {row.policy} | {row.objects} | {trials} | {shares} | {stated} | {row.milliseconds:.0f} |")
    return "\n".join(lines) + "\n"


def condition_table(rows: Sequence[Measured]) -> str:
    """Format each condition: success and secure holds of each policy on each object set."""
    lines = ["| policy | objects | condition | success | secure |", "|---|---|---|--:|--:|"]
    for row in pooled(rows, by=lambda r: (r.policy, r.objects, r.condition)):
        trials = len(row.names)
        shares = " | ".join(_share(sum(part), trials) for part in (row.success, row.secure))
        lines.append(f"| {row.policy} | {row.objects} | {CONDITIONS[row.condition].meaning} | {shares} |")
        if any(row.survives_shake):
            share = _share(sum(row.survives_shake), trials)
            lines.append(f"| {row.policy} | {row.objects} | still held after the shake | {share} | |")
    return "\n".join(lines) + "\n"


def class_table(rows: Sequence[Measured], classes: Mapping[str, Sequence[str]]) -> str:
    """Format success by class of object, over all sets.

    With rows of ``robust_oracle`` on the same trials, the last column gives, for flat and heavy objects, the share of
    the oracle's successes that the policy also achieves.
    """
    everything = {row.policy: row for row in pooled(rows, by=lambda r: r.policy)}
    oracle = everything.get(_ORACLE)
    tried = {obj for row in rows for obj in row.names}
    titles = [f"{name} ({sum(name in classes[obj] for obj in tried)})" for name in CLASSES]
    lines = [
        f"| policy | {' | '.join(titles)} | of the oracle's on flat and heavy |",
        "|---|" + "--:|" * (len(titles) + 1),
    ]
    for policy, row in everything.items():
        cells = []
        for name in CLASSES:
            held = [s for s, obj in zip(row.success, row.names, strict=True) if name in classes[obj]]
            cells.append(f"{100 * sum(held) / len(held):.1f} %" if held else "")
        cells.append("" if oracle is None else _oracle_share(row, oracle, classes))
        lines.append(f"| {policy} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _oracle_share(row: Measured, oracle: Measured, classes: Mapping[str, Sequence[str]]) -> str:
    """Compare with the oracle trial by trial; empty if the trials differ."""
    if row.names != oracle.names:
        return ""
    pairs = zip(row.success, oracle.success, row.names, strict=True)
    held = [mine for mine, theirs, obj in pairs if theirs and {"flat", "heavy"} & set(classes[obj])]
    return _share(sum(held), len(held)) if held else ""
