"""Reports: one HTML file about evaluations, data sets, trials of grasps and trainings (extra ``report``).

>>> import graspbox.tools.reports
>>> path = graspbox.tools.reports.report(["policies/depth/evaluation.json"], "report.html")  # doctest: +SKIP

`report` reads runs and writes the file; ``graspbox report`` does the same on the command line. A run is recognised by
its content:

| run | written by |
|---|---|
| evaluation | ``graspbox evaluate`` with ``--out`` or ``--json``; the folder of ``scripts/evaluate_policies.py`` |
| trials of grasps | ``graspbox grasp`` with ``--out`` or ``--json`` |
| data set | ``graspbox dataset``: its folder |
| training | ``graspbox train``: the folder of a run, or one whose stages are runs |

The file loads nothing: tables that sort and filter, charts (Vega-Altair) and pictures are in it.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graspbox import _core
from graspbox._common.arguments import natural
from graspbox._common.files import check_output, write_text
from graspbox.errors import ConfigError, FileError
from graspbox.evaluation.object_classes import CLASSES
from graspbox.tools.reports import charts, evaluations, failures, grasps, tables, trainings
from graspbox.tools.reports.failures import MAX_PICTURES
from graspbox.tools.reports.page import page
from graspbox.tools.reports.runs import ReportRun
from graspbox.tools.reports.values import read_json

__all__ = ["MAX_PICTURES", "MAX_RUNS", "MAX_TABLE", "ReportRun", "read_run", "report"]

#: Greatest number of runs of a report, and of trials in its table; rates count all trials.
MAX_RUNS, MAX_TABLE = 100, 100_000
#: Objects in the chart of success by object: those with the lowest rates.
_CHARTED = 40
_KINDS = "`graspbox evaluate`, `grasp` or `dataset`, scripts/evaluate_policies.py, or a training"


def read_run(path: str | os.PathLike[str]) -> list[ReportRun]:
    """Read a run, whose content determines its kind; a folder of ``scripts/evaluate_policies.py`` has several.

    Raises
    ------
    ConfigError
        If it is not a run, has no trials or losses yet, or a field is missing or wrong.
    FileError
        If it cannot be read.
    MissingExtraError
        For a data set without pyarrow or pydantic (extra ``data``).
    """
    where = Path(path)
    if where.is_dir():
        if grasps.is_dataset(where):
            return [grasps.read_dataset(where)]
        if evaluations.is_evaluations(where):
            return evaluations.read_evaluations(where)
        if trainings.is_training(where):
            return [trainings.read_training(where)]
        raise ConfigError(f"{str(where)!r} is a folder without a run; name one of {_KINDS}")
    if not where.exists():
        raise FileError(2, "there is no such file or folder", str(where))
    content = read_json(where)
    if evaluations.is_evaluation(content):
        return [evaluations.read_evaluation(where, content)]
    if grasps.is_grasps(content):
        return [grasps.read_grasps(where, content)]
    raise ConfigError(f"{str(where)!r} is no result of {_KINDS}; name one")


def report(
    runs: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    pictures: int = 12,
    trials: int = 20_000,
    title: str = "",
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write a report of runs into one HTML file.

    Parameters
    ----------
    runs : sequence of str or PathLike
        Files and folders: see `read_run`.
    out : str or PathLike
        The file; an existing one is replaced.
    pictures : int
        Greatest number of pictures of failures, 0 to `MAX_PICTURES`; their trials are repeated.
    trials : int
        Greatest number of trials in the table, 0 to `MAX_TABLE`; rates and charts count all.
    title : str
        Title of the page; by default the names of the runs.
    progress : callable
        Called with the numbers of finished and of all pictures.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `read_run`; if `out` cannot be written, or the extra ``report`` is missing.
    """
    for name, value, most in (("pictures", pictures, MAX_PICTURES), ("trials", trials, MAX_TABLE)):
        if natural(value, name) > most:
            raise ConfigError(f"{name} is {value}; it must be in 0 to {most}")
    if not runs:
        raise ConfigError("there are no runs; name at least one file or folder")
    target = check_output(out)
    charts.bundle()
    read = _named([run for path in runs for run in read_run(path)])
    if len(read) > MAX_RUNS:
        raise ConfigError(f"there are {len(read)} runs; a report shows at most {MAX_RUNS}")
    names = [run.name for run in read]
    shown = title or "graspbox report: " + ", ".join(names[:3]) + (f" and {len(names) - 3} more" if names[3:] else "")
    content = _content(read, names, trials)
    content["pictures"] = failures.failure_pictures(read, pictures, progress)
    write_text(target, page(shown, content))
    return target


def _named(runs: list[ReportRun]) -> list[ReportRun]:
    """Make the names of runs unique: a number follows a name that an earlier run has."""
    used: dict[str, int] = {}
    named = []
    for run in runs:
        used[run.name] = used.get(run.name, 0) + 1
        named.append(run if used[run.name] == 1 else replace(run, name=f"{run.name} ({used[run.name]})"))
    return named


def _content(runs: list[ReportRun], names: list[str], trials: int) -> dict[str, Any]:
    classes = tables.classes_of(runs)
    rows = tables.summary_rows(runs, classes)
    pairs = tables.comparisons(runs)
    used = {name for row in rows for name in row["classes"]}
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return {
        "made": f"Made by graspbox {_core.__version__}, {date}.",
        "runs": [
            {name: getattr(run, name) for name in ("name", "kind", "path")}
            | {"facts": dict(run.facts), "refused": dict(run.refused)}
            for run in runs
        ],
        "classes": [[name, meaning] for name, meaning in CLASSES.items() if name in used],
        "summary": rows,
        "trials": tables.trial_columns(runs, trials),
        "pairs": pairs,
        "note": _note(rows),
        "charts": _charts(runs, names, rows, pairs),
    }


def _note(rows: list[dict[str, Any]]) -> str:
    count = len({row["name"] for row in rows if row["group"] == "object"})
    note = f" Of {count} objects, the {_CHARTED} with the lowest rates are plotted." if count > _CHARTED else ""
    if count > tables.MOST_CLASSIFIED:
        note += f" Classes cover {tables.MOST_CLASSIFIED} of them."
    return "Success rates with Wilson 95 % intervals." + note


def _charts(
    runs: list[ReportRun], names: list[str], rows: list[dict[str, Any]], pairs: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    wholes = [row for row in rows if row["group"] == "run"]
    by_class = [row for row in rows if row["group"] == "class"]
    by_class.sort(key=lambda row: list(CLASSES).index(row["name"]))
    reliable = tables.reliability_rows(runs)
    errors = {names[row["run"]]: row["error"] for row in reliable}
    calibration = ", ".join(f"{name}: ECE {error:.3f}" for name, error in list(errors.items())[:4])
    titled: list[tuple[str, dict[str, Any] | None]] = [
        ("Success by run", charts.rate_chart(wholes, names) if len(wholes) > 1 else None),
        ("Success by class of object", charts.rate_chart(by_class, names) if by_class else None),
        ("Failures by kind", charts.failure_chart(wholes, names)),
        (f"Reliability ({calibration})", charts.reliability_chart(reliable, names)),
        ("Difference on common trials", charts.comparison_chart(pairs, names)),
        ("Success by object", _by_object(rows, names)),
    ]
    rates = [{"group": "rates", "title": title, "spec": spec} for title, spec in titled if spec is not None]
    curves = charts.curve_charts(runs, names)
    return rates + [{"group": "curves", "title": measure, "spec": spec} for measure, spec in curves]


def _by_object(rows: list[dict[str, Any]], names: list[str]) -> dict[str, Any] | None:
    """Plot the objects with the lowest rates, the lowest first."""
    best: dict[str, list[float]] = {}
    for row in rows:
        if row["group"] == "object":
            best.setdefault(row["name"], []).append(row["success"][0])
    order = sorted(best, key=lambda name: (sum(best[name]) / len(best[name]), name))[:_CHARTED]
    place = {name: i for i, name in enumerate(order)}
    chosen = [row for row in rows if row["group"] == "object" and row["name"] in place]
    return charts.rate_chart(sorted(chosen, key=lambda row: place[row["name"]]), names) if chosen else None
