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
from graspbox.object_sets import ObjectSpec
from graspbox.tools.reports.runs import Counts, Picture, ReportRun, Trials
from graspbox.tools.reports.values import changed, facts_of, item, mapping_of, read_json, rows_of, spec_of, text

#: Rows and columns of a picture of a failure.
SIZE = (210, 280)
#: From the side, close enough to show the fingers.
_CAMERA = CameraConfig("failure", eye=(-0.42, -0.62, 0.45), target=(0.0, 0.0, 0.14), fov=0.52, far=30.0)
#: Environment whose trials have keys without its name; older files do not name theirs.
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
    numbers = [
        float("nan") if row.get("confidence") is None else float(item(row, "confidence", float, where)) for row in rows
    ]
    return Trials(
        tuple(f"{prefix}{item(row, 'seed', int, where)}" for row in rows),
        objects,
        success,
        np.array([item(row, "secure", bool, where) for row in rows], dtype=np.bool_),
        tuple(str(row.get("failure") or "") for row in rows),
        np.array(numbers, dtype=np.float64),
    )


def read_evaluation(path: Path, content: Mapping[str, Any]) -> ReportRun:
    """Read the JSON of ``graspbox evaluate``, with its trials if ``--out`` wrote it; errors as of `read_run`."""
    where = repr(str(path))
    made = mapping_of(content, "made")
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
        failures = item(content, "failures", dict, where)
        kinds = {str(kind): int(item(failures, kind, int, where)) for kind in failures}
        total = Counts(count, succeeded, secure, kinds)
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


def _rounded(value: Any) -> str | None:
    return f"{value:.2f}" if isinstance(value, int | float) else None


def _specs(sources: Any, objects: Mapping[str, Any]) -> dict[str, ObjectSpec]:
    """Find the objects; without sources, those of procedural families by their names."""
    specs: dict[str, ObjectSpec | None] = {}
    for name in objects:
        row = sources.get(name) if isinstance(sources, Mapping) else None
        if row is None and (match := re.fullmatch(r"([a-z_]+)-(\d{6})", name)):
            row = {"source": f"procedural:{match[1]}:{int(match[2])}", "scale": 1.0, "mass": None}
        specs[name] = spec_of(row)
    return {name: spec for name, spec in specs.items() if spec is not None}


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

    Errors are those of `read_run`.
    """
    path = folder / "results.jsonl"
    rows, where = rows_of(path), repr(str(path))
    if not rows:
        raise ConfigError(f"{where} has no results yet; wait for the first one")
    for row in rows:
        for name in ("policy", "objects", "condition"):
            item(row, name, str, where)
    names = labels(list(dict.fromkeys(row["policy"] for row in rows)))
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["policy"], row["objects"], row["condition"]), []).append(row)
    sets = {objects: _loaded(objects) for objects in {row["objects"] for row in rows}}
    facts = _facts(folder, path)
    return [
        _run(folder, key, names[key[0]], rows_of_run, sets[key[1]], facts, where) for key, rows_of_run in groups.items()
    ]


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
    trial_rows = [trial for row in rows for trial in _rows(row, where)]
    trials = _trials(where, trial_rows, text(rows[0].get("env_id")))
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


def _rows(row: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    """Name the columns of the trials of one job, and add their seeds and kinds of failures."""
    trials = item(row, "trials", list, where)
    if not trials or not all(isinstance(trial, list) for trial in trials):
        raise ConfigError(f"{where}: trials of {row['policy']!r} are not lists of values; measure again")
    try:
        columns = [named(trial) for trial in trials]
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None
    seeds, kinds = item(row, "seeds", list, where), item(row, "kinds", list, where)
    if not len(seeds) == len(kinds) == len(trials):
        raise ConfigError(f"{where}: seeds and kinds of {row['policy']!r} differ in number from trials; measure again")
    return [
        {**named_trial, "seed": seed, "failure": kind}
        for named_trial, seed, kind in zip(columns, seeds, kinds, strict=True)
    ]
