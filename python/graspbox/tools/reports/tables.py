"""Tables of a report as plain values: rates by object and class, reliability, runs compared on common trials.

A row of rates has a Wilson 95 % interval. The difference of two runs on the same trials has the interval of Newcombe's
method 10, and the p-value of McNemar's exact test.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from graspbox.errors import GraspboxError
from graspbox.evaluation.object_classes import CLASSES, object_classes
from graspbox.evaluation.results import reliability, wilson
from graspbox.object_sets import ObjectSpec
from graspbox.policies.published.calibration import calibration_error
from graspbox.tools.reports.runs import Counts, ReportRun, pooled

#: Objects whose class is determined; their meshes are read.
MOST_CLASSIFIED = 400
#: Most comparisons of two runs.
_MOST_PAIRS = 60


def classes_of(runs: Sequence[ReportRun]) -> dict[str, tuple[str, ...]]:
    """Name the classes of every object that is on this machine, of the first `MOST_CLASSIFIED`."""
    specs: dict[str, ObjectSpec] = {}
    for run in runs:
        specs |= {name: spec for name, spec in run.specs.items() if name in run.objects and name not in specs}
    classes: dict[str, tuple[str, ...]] = {}
    for name in list(specs)[:MOST_CLASSIFIED]:
        try:
            classes[name] = object_classes(specs[name].load())
        except GraspboxError:
            continue
    return classes


def rate(count: int, trials: int) -> list[float]:
    """Return a rate and its Wilson 95 % interval."""
    return [round(value, 4) for value in (count / trials, *wilson(count, trials))]


def summary_rows(runs: Sequence[ReportRun], classes: Mapping[str, Sequence[str]]) -> list[dict[str, Any]]:
    """Return rows of the summary: each run, its classes of objects, and its objects."""
    rows = []
    for number, run in enumerate(runs):
        if run.total is None:
            continue
        rows.append(_row(number, "run", run.name, run.total, ()))
        for name in CLASSES:
            members = [counts for obj, counts in run.objects.items() if name in classes.get(obj, ())]
            if members:
                rows.append(_row(number, "class", name, pooled(members), (name,)))
        rows += [_row(number, "object", obj, counts, classes.get(obj, ())) for obj, counts in run.objects.items()]
    return [row for row in rows if row["trials"]]


def _row(run: int, group: str, name: str, counts: Counts, classes: Sequence[str]) -> dict[str, Any]:
    n = counts.trials
    return {
        "run": run,
        "group": group,
        "name": name,
        "classes": list(classes),
        "trials": n,
        "success": rate(counts.succeeded, n) if n else None,
        "secure": rate(counts.secure, n) if n and counts.secure is not None else None,
        "failures": dict(counts.failures),
    }


def trial_columns(runs: Sequence[ReportRun], most: int) -> dict[str, Any]:
    """Return the trials of the page in columns: at most `most` of all runs, the first ones of each.

    ``left_out`` counts the others, by run.
    """
    all_trials = {number: run.trials for number, run in enumerate(runs) if run.trials is not None}
    each = most // max(len(all_trials), 1)
    names = sorted({name for number in all_trials for name in runs[number].objects})
    kinds = sorted({kind for trials in all_trials.values() for kind in trials.failure})
    place, kind_of = ({value: i for i, value in enumerate(values)} for values in (names, kinds))
    columns: dict[str, list[Any]] = {name: [] for name in ("run", "object", "outcome", "kind", "p", "key")}
    for number, trials in all_trials.items():
        count = min(each, len(trials))
        columns["run"] += [number] * count
        columns["object"] += [place[name] for name in trials.objects[:count]]
        # 0 failure, 1 success, 2 secure success.
        columns["outcome"] += (trials.success[:count].astype(int) + (trials.success & trials.secure)[:count]).tolist()
        columns["kind"] += [kind_of[kind] for kind in trials.failure[:count]]
        columns["p"] += [None if math.isnan(p) else round(p, 3) for p in trials.probability[:count].tolist()]
        columns["key"] += trials.keys[:count]
    left_out = {number: len(trials) - each for number, trials in all_trials.items() if len(trials) > each}
    return {"objects": names, "kinds": kinds, "left_out": left_out, **columns}


def reliability_rows(runs: Sequence[ReportRun]) -> list[dict[str, Any]]:
    """Return the bins of the reliability diagram of every run whose trials all have a probability."""
    rows = []
    for number, run in enumerate(runs):
        trials = run.trials
        if trials is None or np.isnan(trials.probability).any():
            continue
        error = calibration_error(trials.probability, trials.success)
        for bin_ in reliability(trials.probability, trials.success):
            rows.append({"run": number, "error": round(error, 4), **{k: round(v, 4) for k, v in vars(bin_).items()}})
    return rows


def comparisons(runs: Sequence[ReportRun]) -> list[dict[str, Any]]:
    """Compare each run with the earlier one that has most trials in common with it, on these trials."""
    pairs: list[dict[str, Any]] = []
    indexed = [
        (n, {key: i for i, key in enumerate(zip(run.trials.keys, run.trials.objects, strict=True))})
        for n, run in enumerate(runs)
        if run.trials is not None
    ]
    for i, (second, theirs) in enumerate(indexed[: _MOST_PAIRS + 1]):
        earlier = [(n, ours) for n, ours in indexed[:i] if runs[n].kind == runs[second].kind]
        if not earlier:
            continue
        first, ours = max(earlier, key=lambda one: len(one[1].keys() & theirs.keys()))
        common = [key for key in ours if key in theirs]
        if common:
            pairs.append(_pair(runs, first, second, [(ours[key], theirs[key]) for key in common]))
    return pairs


def _pair(runs: Sequence[ReportRun], first: int, second: int, rows: Sequence[tuple[int, int]]) -> dict[str, Any]:
    ours, theirs = runs[first].trials, runs[second].trials
    assert ours is not None
    assert theirs is not None
    index = np.array(rows)
    a, b = ours.success[index[:, 0]], theirs.success[index[:, 1]]
    n, only_a, only_b = len(rows), int((a & ~b).sum()), int((b & ~a).sum())
    low, high = difference(int((a & b).sum()), only_a, only_b, n)
    return {
        "first": first,
        "second": second,
        "trials": n,
        "rates": [rate(int(a.sum()), n), rate(int(b.sum()), n)],
        "only": [only_a, only_b],
        "difference": [round(v, 4) for v in ((only_b - only_a) / n, low, high)],
        "p": mcnemar(only_a, only_b),
    }


def difference(both: int, only_a: int, only_b: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of the difference b - a of two rates on the same `n` trials.

    Notes
    -----
    Source: Newcombe, "Improved confidence intervals for the difference between binomial proportions based on paired
    data", Statistics in Medicine 17, 1998, method 10 (square-and-add with the correlation phi).
    """
    a, b, neither = both + only_a, both + only_b, n - both - only_a - only_b
    low_a, high_a = wilson(a, n)
    low_b, high_b = wilson(b, n)
    rate_a, rate_b = a / n, b / n
    spread = a * (n - a) * b * (n - b)
    raw = both * neither - only_a * only_b
    # The continuity correction of the paper applies to a positive correlation.
    phi = 0.0 if not spread else (max(raw - n / 2, 0.0) if raw > 0 else raw) / math.sqrt(spread)
    down_b, up_a = rate_b - low_b, high_a - rate_a
    up_b, down_a = high_b - rate_b, rate_a - low_a
    less = math.sqrt(max(down_b**2 - 2 * phi * down_b * up_a + up_a**2, 0.0))
    more = math.sqrt(max(up_b**2 - 2 * phi * up_b * down_a + down_a**2, 0.0))
    return rate_b - rate_a - less, rate_b - rate_a + more


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the two-sided p-value of McNemar's exact test."""
    n, least = only_a + only_b, min(only_a, only_b)
    if n > 1000:
        # The normal approximation, with the correction for continuity.
        z = max(abs(only_a - only_b) - 1, 0) / math.sqrt(n)
        return math.erfc(z / math.sqrt(2))
    return min(1.0, 2 * sum(math.comb(n, k) for k in range(least + 1)) / 2**n) if n else 1.0
