"""Reads evaluations: the JSON of ``graspbox evaluate`` and the folder of ``scripts/evaluate_policies.py``."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.configs import CameraConfig, PictureConfig
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation.conditions import CONDITIONS
from graspbox.evaluation.replays import Replay
from graspbox.evaluation.reports import labels, named
from graspbox.evaluation.trials import trial_seeds
from graspbox.object_sets import ObjectSpec
from graspbox.reports.runs import Counts, Picture, ReportRun, Trials
from graspbox.reports.values import changed, facts_of, item, read_json, rows_of, text

__all__ = ["SIZE", "is_evaluation", "is_evaluations", "read_evaluation", "read_evaluations"]

#: Rows and columns of a picture of a failure.
SIZE = (210, 280)
#: From the side, close enough to show the fingers.
_CAMERA = CameraConfig("failure", eye=(-0.42, -0.62, 0.45), target=(0.0, 0.0, 0.14), fov=0.52, far=30.0)
#: Environment whose trials have keys without its name; files before this version do not name theirs.
_DEFAULT_ENV = "graspbox/GraspPose-v0"


def is_evaluation(content: Any) -> bool:
    """Return whether JSON is that of ``graspbox evaluate``."""
    return isinstance(content, Mapping) and {"policy", "condition", "rate", "ci95"} <= content.keys()


def is_evaluations(folder: Path) -> bool:
    """Return whether a folder is that of ``scripts/evaluate_policies.py``."""
    return (folder / "results.jsonl").is_file() and (folder / "settings.json").is_file()


def _trials(where: str, rows: Sequence[Mapping[str, Any]], env_id: str) -> Trials:
    prefix = "" if env_id in ("", _DEFAULT_ENV) else f"{env_id}/"
    objects = tuple(str(item(row, "object", str, where)) for row in rows)
    success = np.array([item(row, "success", bool, where) for row in rows], dtype=np.bool_)
    stated = [row.get("confidence") for row in rows]
    numbers = [
        float("nan") if p is None else float(item({"confidence": p}, "confidence", float, where)) for p in stated
    ]
    return Trials(
        tuple(f"{prefix}{item(row, 'seed', int, where)}" for row in rows),
        objects,
        success,
        np.array([item(row, "secure", bool, where) for row in rows], dtype=np.bool_),
        tuple(str(row.get("failure") or "") for row in rows),
        np.array(numbers, dtype=np.float64),
    )


def read_evaluation(path: Path) -> ReportRun:
    """Read the JSON of ``graspbox evaluate``, with its trials if ``--out`` wrote it.

    Raises
    ------
    FileError, ConfigError
        If it cannot be read, or a field is missing or wrong.
    """
    content, where = read_json(path), repr(str(path))
    if not is_evaluation(content):
        raise ConfigError(f"{where} is no result of `graspbox evaluate`; give one")
    made = content.get("made") if isinstance(content.get("made"), Mapping) else {}
    env_id, condition = text(made.get("env_id")), str(item(content, "condition", str, where))
    policy = Path(str(item(content, "policy", str, where))).name
    rows = content.get("rows")
    trials = _trials(where, rows, env_id) if isinstance(rows, list) and rows else None
    if trials is None:
        objects = {}
        for row in item(content, "objects", list, where):
            counts = Counts(item(row, "trials", int, where), item(row, "succeeded", int, where))
            objects[str(item(row, "name", str, where))] = counts
        count, succeeded, secure = (int(item(content, name, int, where)) for name in ("trials", "succeeded", "secure"))
        total = Counts(count, succeeded, secure, _kinds(item(content, "failures", dict, where), where))
    else:
        objects, total = trials.by_object(), trials.counts()
    if not total.trials:
        raise ConfigError(f"{where} has no trials; evaluate with at least one")
    facts = {
        **{name: made.get(name) for name in ("command", "graspbox", "date")},
        "environment": env_id,
        "condition": condition,
        "seed": made.get("seed"),
        "settings": made.get("settings"),
        "ms per decision": _rounded(content.get("ms_per_decision")),
        "objects left out": content.get("objects_left_out") or None,
        "file changed": None if made.get("date") else changed(path),
    }
    name = policy if condition == "nominal" else f"{policy}, {condition}"
    return ReportRun(
        name,
        "evaluation",
        str(path),
        facts_of(facts),
        total,
        objects,
        trials,
        _specs(content.get("sources"), objects),
        pictures=_pictures(content.get("replays"), env_id, made.get("settings")),
        refused=facts_of(content.get("refused") or {}),
    )


def _kinds(failures: Mapping[str, Any], where: str) -> dict[str, int]:
    return {str(kind): int(item(failures, kind, int, where)) for kind in failures}


def _rounded(value: Any) -> str | None:
    return f"{value:.2f}" if isinstance(value, int | float) else None


def _specs(sources: Any, objects: Mapping[str, Any]) -> dict[str, ObjectSpec]:
    """Find the objects; those of files without sources are looked up by their names."""
    found: dict[str, ObjectSpec] = {}
    for name in objects:
        row = sources.get(name) if isinstance(sources, Mapping) else None
        try:
            if isinstance(row, Mapping):
                found[name] = object_sets.load(str(row["source"]), scale=row["scale"], mass=row["mass"])[0]
            elif match := re.fullmatch(r"([a-z_]+)-(\d{6})", name):
                found[name] = object_sets.load(f"procedural:{match[1]}:{int(match[2])}")[0]
        except (GraspboxError, KeyError, TypeError, ValueError):
            continue
    return found


def _pictures(rows: Any, env_id: str, settings: Any) -> tuple[Picture, ...]:
    if not isinstance(rows, list) or not isinstance(settings, Mapping):
        return ()
    replays = [Replay.from_json(row, env_id, settings) for row in rows]
    return tuple(Picture(r.object, r.failure, f"seed {r.seed}", _renderer(r)) for r in replays)


def _renderer(replay: Replay) -> Any:
    def render() -> tuple[list[NDArray[np.uint8]], str]:
        picture = PictureConfig(image_size=SIZE, camera=_CAMERA)
        env = replay.make(obs="proprio", render_mode="rgb_array", picture=picture)
        try:
            *_, (_, info) = replay.run(env)
            return [env.render()], "" if info["is_success"] else str(info["failure"])
        finally:
            env.close()

    return render


def read_evaluations(folder: Path) -> list[ReportRun]:
    """Read the folder of ``scripts/evaluate_policies.py``: a run for each policy, object set and condition.

    Raises
    ------
    FileError, ConfigError
        If it cannot be read, or a row is not one of an evaluation.
    """
    path = folder / "results.jsonl"
    rows, where = rows_of(path), repr(str(path))
    if not rows:
        raise ConfigError(f"{where} has no results yet; let the evaluation finish its first one")
    for row in rows:
        for name in ("policy", "objects", "condition"):
            item(row, name, str, where)
    named = labels(list(dict.fromkeys(row["policy"] for row in rows)))
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["policy"], row["objects"], row["condition"]), []).append(row)
    sets = {objects: _loaded(objects) for objects in {row["objects"] for row in rows}}
    facts = _facts(folder, path)
    return [_run(folder, key, named[key[0]], found, sets[key[1]], facts, where) for key, found in groups.items()]


def _loaded(objects: str) -> dict[str, ObjectSpec]:
    """Load an object set by its name; empty where it is not on this machine."""
    name, split = object_sets.name_and_split(objects)
    try:
        return {spec.name: spec for spec in object_sets.load(name, split=split)}
    except GraspboxError:
        return {}


def _facts(folder: Path, path: Path) -> dict[str, Any]:
    page = folder / "evaluation.md"
    command = re.search(r"```\n(.*?)\n```", page.read_text(errors="replace")) if page.is_file() else None
    settings = read_json(folder / "settings.json")
    return {"command": command and command[1], "settings": settings, "file changed": changed(path)}


def _run(
    folder: Path,
    key: tuple[str, str, str],
    label: str,
    rows: list[dict[str, Any]],
    specs: Mapping[str, ObjectSpec],
    facts: Mapping[str, Any],
    where: str,
) -> ReportRun:
    policy, objects, condition = key
    found: list[dict[str, Any]] = []
    for row in rows:
        found += _rows(row, where)
    trials = _trials(where, found, text(rows[0].get("env_id")))
    counts = trials.by_object()
    meaning = CONDITIONS[condition].meaning if condition in CONDITIONS else condition
    own = {
        "policy": policy,
        "objects": objects,
        "condition": f"{condition}: {meaning}",
        "seeds": ", ".join(text(row.get("seed")) for row in rows),
        "ms per decision": _rounded(np.mean([item(row, "milliseconds", float, where) for row in rows])),
    }
    parts = [label, objects, *([] if condition == "nominal" else [condition])]
    known = {name: specs[name] for name in counts if name in specs}
    total = trials.counts()
    return ReportRun(
        ", ".join(parts), "evaluation", str(folder), facts_of({**facts, **own}), total, counts, trials, known
    )


def _named(trial: list[Any], where: str) -> dict[str, Any]:
    try:
        return named(trial)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _rows(row: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    """Name the columns of the trials of one job; rows of former versions have neither seeds nor kinds of failures."""
    trials = item(row, "trials", list, where)
    if not trials or not all(isinstance(trial, list) for trial in trials):
        raise ConfigError(f"{where}: trials of {row['policy']!r} are not lists of values; measure again")
    columns = [_named(trial, where) for trial in trials]
    seeds = row.get("seeds") or trial_seeds(item(row, "seed", int, where), len(trials))
    kinds = row.get("kinds") or [""] * len(trials)
    if not len(seeds) == len(kinds) == len(trials):
        raise ConfigError(f"{where}: seeds and kinds of {row['policy']!r} differ in number from trials; measure again")
    return [
        {**named_trial, "seed": seed, "failure": kind}
        for named_trial, seed, kind in zip(columns, seeds, kinds, strict=True)
    ]
