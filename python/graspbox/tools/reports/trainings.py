"""Reads training runs: curves of losses, measures and evaluations, settings, results."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.tools.reports.runs import SHARES, ReportRun, TrainingCurve
from graspbox.tools.reports.values import changed, facts_of, read_json, rows_of

#: Depth of the folders of stages below a run, and the greatest number of curves of a run.
_DEPTH, _MOST_CURVES = 3, 60
#: Greatest number of points of a curve; further ones are thinned evenly.
_POINTS = 400
_LOSSES, _EVALUATIONS = "losses.jsonl", "evaluations.jsonl"
#: Measures of an evaluation, as charts name them.
_MEASURES = {
    "success": SHARES[0],
    "secure": SHARES[1],
    "return": "return on held-out objects",
    "length": "steps of an episode on held-out objects",
}


def is_training(folder: Path) -> bool:
    """Return whether a folder is a training run, or has stages that are."""
    return (folder / _EVALUATIONS).is_file() or any(_losses(folder))


def _losses(folder: Path) -> Iterator[Path]:
    """List the files of losses of a run and of its stages."""
    for depth in range(_DEPTH + 1):
        yield from sorted(folder.glob("/".join(["*"] * depth + [_LOSSES])))


def read_training(folder: Path) -> ReportRun:
    """Read a training run, even an unfinished one; errors as of `read_run`."""
    evaluated = rows_of(folder / _EVALUATIONS) if (folder / _EVALUATIONS).is_file() else []
    shown = [
        {"step": row.get("timesteps"), **{told: row.get(name) for name, told in _MEASURES.items()}} for row in evaluated
    ]
    curves = _curves("", shown, folder / _EVALUATIONS)
    for path in _losses(folder):
        training = "" if path.parent == folder else str(path.parent.relative_to(folder))
        curves += _curves(training, rows_of(path), path)
    if not curves:
        raise ConfigError(f"{str(folder)!r} has no losses yet; wait for the first row")
    facts: dict[str, Any] = {}
    if evaluated:
        facts["best evaluation"] = max(evaluated, key=lambda row: (row.get("success") or 0.0, row.get("return") or 0.0))
        facts["last evaluation"] = evaluated[-1]
    for name in ("settings", "results", "baselines"):
        if (folder / f"{name}.json").is_file():
            facts[name] = read_json(folder / f"{name}.json")
    for path in sorted(folder.glob("*.json")):
        if path.stem not in ("settings", "results", "clock") and (folder / path.stem).is_dir():
            facts[f"stage {path.stem}"] = read_json(path)
    if len(curves) > _MOST_CURVES:
        facts["curves"] = f"the first {_MOST_CURVES} of {len(curves)}"
    facts |= _dates(folder)
    name = folder.resolve().name
    return ReportRun(name, "training", str(folder), facts_of(facts), curves=tuple(curves[:_MOST_CURVES]))


def _curves(training: str, rows: list[dict[str, Any]], path: Path) -> list[TrainingCurve]:
    points: dict[str, list[tuple[float, float]]] = {}
    for number, row in enumerate(rows, 1):
        if not _is_number(row.get("step")):
            raise ConfigError(f"{str(path)!r}: line {number} has no step; name the folder of a training run")
        for name, value in row.items():
            if name not in ("step", "seconds") and _is_number(value):
                points.setdefault(name, []).append((row["step"], value))
    return [TrainingCurve(training, name, *zip(*_thinned(places), strict=True)) for name, places in points.items()]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")


def _thinned(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    if len(points) <= _POINTS:
        return points
    return [points[round(i * (len(points) - 1) / (_POINTS - 1))] for i in range(_POINTS)]


def _dates(folder: Path) -> Mapping[str, str]:
    """Read the times of the first and the last entry of the log."""
    log = folder / "log.txt"
    if not log.is_file():
        files = [*_losses(folder), *folder.glob(_EVALUATIONS)]
        newest = max(files, key=lambda path: path.stat().st_mtime)
        return {"file changed": changed(newest)}
    with log.open(errors="replace") as file:
        began = file.readline(200)[:19]
    return {"began": f"{began} UTC", "file changed": changed(log)}
