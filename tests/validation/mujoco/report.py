"""Results of a comparison of both engines: one row per trial, and statistics."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspbox.hands.description import Array
from validation.agreement import kappa
from validation.mujoco.replay import Outcome
from validation.versions import MUJOCO_VERSION

Why = Literal["core undecided", "mujoco undecided", "both undecided", "engines disagree"]


@dataclass(frozen=True)
class Row:
    """One trial in both engines."""

    object: str
    success: bool
    failure: str
    lift: float
    mujoco: Outcome
    world_from_hand: Array
    object_from_hand: Array
    preshape: float
    #: Success in the core and in MuJoCo at half their time step; None if the trial was not repeated.
    halved: tuple[bool, bool] | None = None

    @property
    def equal(self) -> bool:
        """Whether both engines have the same label."""
        return self.success == self.mujoco.success

    @property
    def why(self) -> Why | None:
        """Which engine's label changes with the time step, if the labels differ and the trial was repeated."""
        if self.equal or self.halved is None:
            return None
        core, mujoco = self.halved[0] != self.success, self.halved[1] != self.mujoco.success
        if core and mujoco:
            return "both undecided"
        if core:
            return "core undecided"
        return "mujoco undecided" if mujoco else "engines disagree"

    def to_json(self) -> dict[str, Any]:
        """Return the values as JSON types."""
        return {
            "object": self.object,
            "core": {"success": self.success, "failure": self.failure or None, "lift": self.lift},
            "mujoco": {
                "success": self.mujoco.success,
                "failure": self.mujoco.failure,
                "lift": self.mujoco.lift,
                "speed": self.mujoco.speed,
                "links_at_lift": self.mujoco.touching[0],
                "links_at_end": self.mujoco.touching[1],
                "depth": self.mujoco.depth,
            },
            "world_from_hand": self.world_from_hand.tolist(),
            "preshape": self.preshape,
            "why": self.why,
        }


class Agreement:
    """Rows that have equal labels, for a report with `rows`."""

    rows: list[Any]

    @property
    def equal(self) -> int:
        """Number of trials with equal labels."""
        return sum(row.equal for row in self.rows)

    @property
    def share(self) -> float:
        """Share of equal labels."""
        return self.equal / len(self.rows) if self.rows else 0.0


@dataclass
class Report(Agreement):
    """Result of a comparison."""

    rows: list[Row] = field(default_factory=list)
    #: Trials in collision at the start in MuJoCo only.
    infeasible: int = 0
    #: Objects without enough feasible poses.
    left_out: list[str] = field(default_factory=list)
    #: Labels changed by the core's early stops; should be 0.
    early_stop_changed: int = 0
    threads: int = 1
    core_seconds: float = 0.0
    core_full_seconds: float = 0.0
    mujoco_seconds: float = 0.0

    @property
    def bias(self) -> float:
        """The core's success rate minus MuJoCo's."""
        excess = sum(row.success - row.mujoco.success for row in self.rows)
        return excess / len(self.rows) if self.rows else 0.0

    def labels(self) -> dict[str, NDArray[np.bool_]]:
        """Return the labels by engine, including those at half the time step if every trial was repeated."""
        labels = {"core": [r.success for r in self.rows], "mujoco": [r.mujoco.success for r in self.rows]}
        halved = [row.halved for row in self.rows if row.halved is not None]
        if self.rows and len(halved) == len(self.rows):
            labels |= {"core, half dt": [h[0] for h in halved], "mujoco, half dt": [h[1] for h in halved]}
        return {name: np.array(values, dtype=bool) for name, values in labels.items()}

    def agreements(self) -> dict[str, dict[str, float]]:
        """Return the share of equal labels and kappa for every pair of runs."""
        if not self.rows:
            return {}
        labels = list(self.labels().items())
        return {
            f"{one} / {two}": {"share": float(np.mean(a == b)), "kappa": kappa(a, b)}
            for i, (one, a) in enumerate(labels)
            for two, b in labels[i + 1 :]
        }

    def _rate(self, seconds: float) -> float:
        return len(self.rows) / seconds if seconds > 0.0 else 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the values as JSON types."""
        different = [row for row in self.rows if not row.equal]
        kinds = Counter(f"{row.failure or 'success'} / {row.mujoco.failure or 'success'}" for row in different)
        return {
            "mujoco_version": MUJOCO_VERSION,
            "trials": len(self.rows),
            "equal": self.equal,
            "share": self.share,
            "bias": self.bias,
            "core_success": sum(row.success for row in self.rows),
            "mujoco_success": sum(row.mujoco.success for row in self.rows),
            "successes": {name: int(values.sum()) for name, values in self.labels().items()},
            "agreements": self.agreements(),
            "infeasible_in_mujoco": self.infeasible,
            "left_out": self.left_out,
            "early_stop_changed": self.early_stop_changed,
            "threads": self.threads,
            "trials_per_s": {
                "core": self._rate(self.core_seconds),
                "core_without_early_stops": self._rate(self.core_full_seconds),
                "mujoco": self._rate(self.mujoco_seconds),
            },
            "by_kind": dict(kinds.most_common()),
            "by_why": dict(Counter(str(row.why) for row in different).most_common()),
            "by_object": dict(Counter(row.object for row in different).most_common()),
            "different": [row.to_json() for row in different],
        }
