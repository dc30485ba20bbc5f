"""Shares of grasps that pass, by source and engine, and the agreement of the engines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from graspbox.evaluation.results import wilson
from validation.agreement import kappa
from validation.forces.config import Verdict
from validation.forces.measures import ferrari_canny, residual

__all__ = ["SourceResult", "markdown", "to_json"]

#: The four verdicts, and what a table calls them.
VERDICTS = {"passes": "six forces", "holds": "held", "lifts": "lift", "keeps": "held on the lift"}


@dataclass
class SourceResult:
    """Verdicts on the grasps of one source.

    Attributes
    ----------
    name : str
        Name of the source.
    verdicts : dict
        By engine, a list of verdicts in the order of the grasps.
    missing : int
        Trials in which a policy chose no grasp; they count as failed.
    own : tuple of int or None
        Numbers of successes and of secure grasps in the policy's own trials.
    """

    name: str
    verdicts: dict[str, list[Verdict]] = field(default_factory=dict)
    missing: int = 0
    own: tuple[int, int] | None = None

    def facts(self, engine: str) -> dict[str, Any]:
        """Return counts and means of an engine; means are null without a grasp that began."""
        verdicts = self.verdicts[engine]
        begun = [verdict for verdict in verdicts if verdict.closed_depth == verdict.closed_depth]
        return {
            "grasps": len(verdicts) + self.missing,
            **{name: sum(bool(getattr(verdict, name)) for verdict in verdicts) for name in VERDICTS},
            "too_deep": len(verdicts) - len(begun),
            "q1": _mean(begun, lambda verdict: ferrari_canny(verdict.contacts)),
            "residual": _mean([v for v in begun if v.contacts], lambda verdict: residual(verdict.contacts)),
            "links": _mean(begun, lambda verdict: float(verdict.links)),
            "closed_depth": _mean(begun, lambda verdict: verdict.closed_depth),
        }

    def agreements(self) -> list[dict[str, Any]]:
        """Compare every pair of engines, verdict by verdict."""
        rows = []
        for one, two in combinations(self.verdicts, 2):
            for name in VERDICTS:
                a, b = (np.array([getattr(v, name) for v in self.verdicts[engine]], bool) for engine in (one, two))
                if len(a):
                    equal = int(np.sum(a == b))
                    rows.append(
                        {"engines": [one, two], "verdict": name, "grasps": len(a), "equal": equal, "kappa": kappa(a, b)}
                    )
        return rows


def _mean(verdicts: Sequence[Verdict], measure: Callable[[Verdict], float]) -> float | None:
    values = [measure(verdict) for verdict in verdicts]
    return float(np.mean(values)) if values else None


def to_json(results: Sequence[SourceResult]) -> list[dict[str, Any]]:
    """Plain values."""
    rows = []
    for result in results:
        engines = {engine: result.facts(engine) for engine in result.verdicts}
        own = None if result.own is None else {"success": result.own[0], "secure": result.own[1]}
        rows.append({"source": result.name, "engines": engines, "agreements": result.agreements(), "own": own})
    return rows


def _share(count: int, trials: int) -> str:
    if trials == 0:
        return "-"
    low, high = wilson(count, trials)
    return f"{100 * count / trials:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _number(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Write the tables of what `to_json` returned; brackets hold 95 % intervals (Wilson)."""
    columns = ["grasps of", "engine", "grasps", *VERDICTS.values(), "Q1", "residual", "links", "depth, mm"]
    lines = ["| " + " | ".join(columns) + " |"]
    lines.append("|---|---|--:|" + "--:|" * (len(VERDICTS) + 4))
    for row in rows:
        if row["own"] is not None:
            count = next(iter(row["engines"].values()))["grasps"]
            own = ", ".join(f"{name} {_share(number, count)}" for name, number in row["own"].items())
            lines.append(f"| {row['source']} | its own trials | {count} | {own} |" + " |" * (len(VERDICTS) + 3))
        for engine, facts in row["engines"].items():
            shares = " | ".join(_share(facts[name], facts["grasps"]) for name in VERDICTS)
            means = (_number(facts["q1"], 1, 3), _number(facts["residual"], 1, 4), _number(facts["links"], 1, 1))
            depth = _number(facts["closed_depth"], 1e3, 2)
            lines.append(
                f"| {row['source']} | {engine} | {facts['grasps']} | {shares} | {' | '.join(means)} | {depth} |"
            )
    pairs = [(row["source"], pair) for row in rows for pair in row["agreements"]]
    if pairs:
        lines += ["", "| grasps of | engines | verdict | equal | kappa |", "|---|---|---|--:|--:|"]
        for source, pair in pairs:
            equal = f"{pair['equal']} of {pair['grasps']}"
            engines, verdict = " and ".join(pair["engines"]), VERDICTS[pair["verdict"]]
            lines.append(f"| {source} | {engines} | {verdict} | {equal} | {pair['kappa']:.2f} |")
    return "\n".join(lines)
