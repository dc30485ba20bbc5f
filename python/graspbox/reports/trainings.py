"""Reads training runs of `graspbox.training`: curves of losses and measures, settings, results."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.reports.runs import Curve, ReportRun
from graspbox.reports.values import changed, facts_of, read_json, rows_of

__all__ = ["is_training", "read_training"]

#: Depth of the folders of stages below a run, and the greatest number of curves of a run.
_DEPTH, _MOST_CURVES = 3, 60
#: Greatest number of points of a curve; further ones are thinned evenly.
_POINTS = 400
_LOSSES = "losses.jsonl"


def is_training(folder: Path) -> bool:
    """Return whether a folder is a training run, or has stages that are."""
    return any(_losses(folder))


def _losses(folder: Path) -> Iterator[Path]:
    """Find the rows of losses of a run and of its stages."""
    for depth in range(_DEPTH + 1):
        yield from sorted(folder.glob("/".join(["*"] * depth + [_LOSSES])))


def read_training(folder: Path) -> ReportRun:
    """Read a training run, even while it is training.

    Raises
    ------
    FileError, ConfigError
        If a file cannot be read, or no row has a step and a loss.
    """
    curves: list[Curve] = []
    for path in _losses(folder):
        training = "" if path.parent == folder else str(path.parent.relative_to(folder))
        curves += _curves(training, rows_of(path), path)
    if not curves:
        raise ConfigError(f"{str(folder)!r} has no losses yet; let the training run until its first row")
    facts: dict[str, Any] = {}
    for name in ("settings", "results"):
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


def _curves(training: str, rows: list[dict[str, Any]], path: Path) -> list[Curve]:
    points: dict[str, list[tuple[float, float]]] = {}
    for number, row in enumerate(rows, 1):
        if not _is_number(row.get("step")):
            raise ConfigError(f"{str(path)!r}: line {number} has no step; name the folder of a training run")
        for name, value in row.items():
            if name not in ("step", "seconds") and _is_number(value):
                points.setdefault(name, []).append((row["step"], value))
    return [Curve(training, name, *zip(*_thinned(found), strict=True)) for name, found in points.items()]


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
        newest = max(_losses(folder), key=lambda path: path.stat().st_mtime)
        return {"file changed": changed(newest)}
    with log.open(errors="replace") as file:
        began = file.readline(200)[:19]
    return {"began": f"{began} UTC", "file changed": changed(log)}
