"""Reads trials of hand poses: the JSON of ``graspbox grasp``, and the data sets of ``graspbox dataset``."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import config_of, shown
from graspbox._common.colors import OBJECT
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.hands.loading import hand_like
from graspbox.object_sets import ObjectSpec
from graspbox.simulation import Scene
from graspbox.tools.reports.evaluations import SIZE
from graspbox.tools.reports.runs import MAX_TRIALS, Counts, Picture, ReportRun, Trials, pooled
from graspbox.tools.reports.values import changed, facts_of, item, mapping_of, spec_of, text

#: Failures of each kind that are kept for pictures.
_PER_KIND = 6


def is_grasps(content: Any) -> bool:
    """Return whether JSON is that of ``graspbox grasp``."""
    return isinstance(content, Mapping) and {"objects", "tried", "first_rate", "objects_with_success"} <= content.keys()


def is_dataset(folder: Path) -> bool:
    """Return whether a folder is a data set of ``graspbox dataset``."""
    return (folder / "manifest.json").is_file() and (folder / "trials").is_dir()


def read_grasps(path: Path, content: Mapping[str, Any]) -> ReportRun:
    """Read the JSON of ``graspbox grasp``, with its trials if it has the details; errors as of `read_run`."""
    where, made = repr(str(path)), mapping_of(content, "made")
    objects = item(content, "objects", list, where)
    rows = [(obj, grasp) for obj in objects for grasp in _grasps(obj, where)]
    counts = {}
    for obj in objects:
        tried, succeeded, secure = (int(item(obj, name, int, where)) for name in ("tried", "succeeded", "secure"))
        counts[str(item(obj, "name", str, where))] = Counts(tried, succeeded, secure)
    total, trials = pooled(list(counts.values())), None
    if rows:
        trials = _trials(rows, where)
        counts, total = trials.by_object(), trials.counts()
    if not total.trials:
        raise ConfigError(f"{where} has no trials; try at least one pose")
    facts = {
        **{name: made.get(name) for name in ("command", "graspbox", "date", "hand", "seed")},
        "first-ranked poses": f"{item(content, 'first_rate', float, where):.1%} succeed",
        "objects with a success": f"{content['objects_with_success']} of {len(objects)}",
        "trial": made.get("trial"),
        "file changed": None if made.get("date") else changed(path),
    }
    specs = {str(obj["name"]): spec for obj in objects if (spec := spec_of(obj)) is not None}
    hand, trial = made.get("hand"), made.get("trial")
    config = config_of(TrialConfig, trial, f"{where}: trial") if isinstance(trial, Mapping) else TrialConfig()
    pictures = _pictures(rows, specs, hand if isinstance(hand, str) else None, config, where)
    return ReportRun(
        path.stem,
        "grasps",
        str(path),
        facts_of(facts),
        total,
        counts,
        trials,
        specs,
        pictures=pictures,
        refused=facts_of(content.get("refused") or {}),
    )


def _grasps(obj: Any, where: str) -> list[dict[str, Any]]:
    if not isinstance(obj, Mapping):
        raise ConfigError(f"{where}: an entry of objects is not an object of JSON; try the grasps again")
    grasps = obj.get("grasps") or []
    if not isinstance(grasps, list) or not all(isinstance(grasp, dict) for grasp in grasps):
        raise ConfigError(f"{where}: grasps of {text(obj.get('name'))!r} are not a list of grasps; try them again")
    return grasps


def _trials(rows: list[tuple[Mapping[str, Any], dict[str, Any]]], where: str) -> Trials:
    keys = []
    for obj, grasp in rows:
        pose = _pose(grasp, "object_from_hand", where).round(6)
        facts = f"{obj.get('hand')}/{item(grasp, 'preshape', float, where):.6f}".encode()
        keys.append(f"{obj['name']}/{hashlib.blake2s(pose.tobytes() + facts, digest_size=5).hexdigest()}")
    success, secure = (
        np.array([item(grasp, name, bool, where) for _, grasp in rows], dtype=np.bool_)
        for name in ("success", "secure")
    )
    kinds = tuple(str(item(grasp, "failure", str, where)) for _, grasp in rows)
    names = tuple(str(obj["name"]) for obj, _ in rows)
    return Trials(tuple(keys), names, success, secure, kinds, np.full(len(rows), np.nan))


def _pose(row: Mapping[str, Any], name: str, where: str) -> NDArray[np.float64]:
    """Read a pose (4, 4)."""
    try:
        pose = np.asarray(row.get(name), dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.zeros(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ConfigError(f"{where}: {name} is {shown(row.get(name))}, not a pose (4, 4); try the grasps again")
    return pose


def _pictures(
    rows: list[tuple[Mapping[str, Any], dict[str, Any]]],
    specs: Mapping[str, ObjectSpec],
    hand: str | None,
    config: TrialConfig,
    where: str,
) -> tuple[Picture, ...]:
    """Keep the first failures of each kind, of different objects first."""
    seen: Counter[tuple[str, str]] = Counter()
    failed = []
    for obj, grasp in rows:
        kind, name = grasp["failure"], str(obj["name"])
        if not grasp["success"] and name in specs:
            failed.append((seen[kind, name], kind, name, obj, grasp))
            seen[kind, name] += 1
    pictures: dict[str, list[Picture]] = {}
    for _, kind, name, obj, grasp in sorted(failed, key=lambda one: one[0]):
        kept = pictures.setdefault(kind, [])
        if len(kept) < _PER_KIND:
            pose, rest = _pose(grasp, "object_from_hand", where), _pose(obj, "world_from_object", where)
            description = f"pose {1 + obj['grasps'].index(grasp)} of the ranking"
            trial = _Trial(specs[name], hand or str(obj["hand"]), rest, pose, float(grasp["preshape"]), config)
            kept.append(Picture(name, kind, description, trial.render))
    return tuple(picture for kept in pictures.values() for picture in kept)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A trial of a hand pose that can be repeated; poses are metres, `hand` is as on the command line."""

    spec: ObjectSpec
    hand: str
    world_from_object: NDArray[np.float64]
    object_from_hand: NDArray[np.float64]
    preshape: float
    config: TrialConfig
    physics: PhysicsConfig = PhysicsConfig()  # noqa: RUF009 (frozen)
    mass: float | None = None

    def render(self) -> tuple[list[NDArray[np.uint8]], str]:
        """Run and render it: closed, and at the end; or the open hand, if it is infeasible."""
        from graspbox.pictures import Camera, PosedHand, Solid, Trial, View
        from graspbox.pictures.trials import BESIDE, stages, views

        mesh = (self.spec if self.mass is None else replace(self.spec, mass=self.mass)).load()
        hand = load_hand(hand_like(self.hand))
        scene = Scene(mesh, hand=hand, world_from_object=self.world_from_object, physics=self.physics)
        outcomes, trace = scene.trace(self.object_from_hand, self.preshape, config=self.config)
        failure, rest, (rows, columns) = str(outcomes.failure[0]), scene.world_from_object, SIZE
        if not len(trace.time):
            posed = PosedHand.open(hand, rest @ self.object_from_hand, self.preshape)
            eye = Camera.across(posed.world_from_hand[:3, 2], elevation=BESIDE)
            solid = Solid(mesh, OBJECT, rest)
            return [View([solid], eye, size=(columns, rows), hand=posed, table=True).image], failure
        samples = dict.fromkeys((dict(stages(trace))["closed"], len(trace.time) - 1))
        size = (columns, rows) if len(samples) == 1 else (7 * columns // 10, rows)
        trial = Trial(0, self.preshape, outcomes, trace)
        return [view.image for sample in samples for view in views(scene, trial, [sample], None, size)], failure


def read_dataset(folder: Path) -> ReportRun:
    """Read a data set, even an incomplete one; errors as of `read_run`."""
    from graspbox.data.trials import column, manifest, tables

    made = manifest.read(folder)
    if made is None:
        raise ConfigError(f"{str(folder)!r} has no manifest; name the folder of `graspbox dataset`")
    count = sum(shard["trials"] for shard in made["shards"])
    if count > MAX_TRIALS:
        raise ConfigError(f"{str(folder)!r} has {count} trials; a report reads at most {MAX_TRIALS}")
    names = ["scene", "trial", "seed", "object", "success", "secure", "failure", "split", "candidate"]
    table = tables.load(folder, columns=names)
    scene, trial, seed, objects, success, secure, failure = (column(table, name).tolist() for name in names[:7])
    keys = tuple(f"{s}/{t}/{x}" for s, t, x in zip(scene, trial, seed, strict=True))
    flags = np.array(success, dtype=np.bool_), np.array(secure, dtype=np.bool_)
    trials = Trials(keys, tuple(objects), *flags, tuple(failure), np.full(len(keys), np.nan))
    specs = {row["name"]: spec for row in made["objects"] if (spec := spec_of(row)) is not None}
    splits, sources = (_shares(column(table, name), flags[0]) for name in ("split", "candidate"))
    facts = {
        "versions": made["versions"],
        "hand": made["hand"]["name"],
        "complete": "yes" if made["complete"] else "no, it is still being made",
        "splits": splits,
        "sources of poses": sources,
        "settings": made["config"],
        "file changed": changed(folder / manifest.FILE),
    }
    pictures = _dataset_pictures(folder, trials, specs, made)
    return ReportRun(
        folder.resolve().name,
        "data set",
        str(folder),
        facts_of(facts),
        trials.counts(),
        trials.by_object(),
        trials,
        specs,
        pictures=pictures,
        refused=facts_of(made["refused"]),
    )


def _shares(values: NDArray[Any], success: NDArray[np.bool_]) -> str:
    return ", ".join(f"{v}: {success[values == v].mean():.1%} of {(values == v).sum()}" for v in np.unique(values))


def _dataset_pictures(
    folder: Path, trials: Trials, specs: Mapping[str, ObjectSpec], made: Mapping[str, Any]
) -> tuple[Picture, ...]:
    """Keep the first failures of each kind, each of another object, with the poses and factors that were tried."""
    chosen: dict[tuple[str, str], int] = {}
    for row, (kind, name) in enumerate(zip(trials.failure, trials.objects, strict=True)):
        if kind and name in specs and sum(k == kind for k, _ in chosen) < _PER_KIND:
            chosen.setdefault((kind, name), row)
    if not chosen:
        return ()
    from graspbox.data.trials import column, matrices, tables

    names = ["world_from_object", "executed_object_from_hand", "preshape", "friction", "mass", "scene", "trial"]
    part = tables.load(folder, columns=names).take(list(chosen.values()))
    rests, poses = matrices(part, "world_from_object"), matrices(part, "executed_object_from_hand")
    preshapes, frictions, masses, scenes, numbers = (column(part, name).tolist() for name in names[2:])
    config = config_of(TrialConfig, made["config"]["trial"], "trial")
    physics = config_of(PhysicsConfig, made["config"]["physics"], "physics")
    pictures = []
    for i, (kind, name) in enumerate(chosen):
        own = replace(physics, friction=replace(physics.friction, object=frictions[i]))
        trial = _Trial(specs[name], made["hand"]["name"], rests[i], poses[i], preshapes[i], config, own, masses[i])
        pictures.append(Picture(name, kind, f"{scenes[i]}, trial {numbers[i]}", trial.render))
    return tuple(pictures)
