"""Replay of trials in exported scenes: everything but the law of the drives comes from the files of the export.

`compare_exports` runs the same trials in the judge's own model, too, and counts equal labels. In scenes of several
objects it also measures how far they drift at rest.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import graspbox
from graspbox import _core
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand, HandLike, description, load_hand
from graspbox.hands.description import Array
from graspbox.simulation.layouts import Arrangement, SceneLayout
from graspbox.tools.scene_export import export_scene
from graspbox.tools.scene_export.contents import ObjectData, object_data, object_names, objects_of, walls_of
from graspbox.tools.scene_export.mjcf import KEYFRAME, LIFT_GROUP
from graspbox.tools.scene_export.records import SCENE_FORMAT
from validation.engines import HEAPED, targets
from validation.mujoco.compare import check_settings, describe, scenes
from validation.mujoco.replay import Outcome, Replay, TrialTimes, replay, run_trial
from validation.mujoco.report import Agreement
from validation.mujoco.sampling import Source, sample_trials
from validation.mujoco.scene import Numerics, Scene, build, build_heap, indexed
from validation.versions import MUJOCO_VERSION

#: Objects of several families: upright and flat, round and square, hollow and solid, light and heavy.
EXPORT_OBJECTS = tuple(
    f"procedural:{family}:2"
    for family in ("ball", "banana", "bottle", "bowl", "box", "can", "hammer", "kettle", "mug", "wine_glass")
)
#: For how long scenes of several objects must stay at rest, s.
REST = 1.0
#: Largest file of an export to read, bytes.
_MAX_BYTES = 16 << 20


@dataclass(frozen=True)
class ExportedScene:
    """An exported scene as it is loaded: the model, and the preshape that its files name."""

    scene: Scene
    preshape: float


def _record(folder: Path) -> dict[str, Any]:
    path = folder / "scene.json"
    try:
        record = json.loads(read_bounded(path, _MAX_BYTES))
    except (ValueError, RecursionError):
        raise ConfigError(f"{str(path)!r} is not JSON; export the scene again") from None
    if not isinstance(record, dict) or record.get("format") != SCENE_FORMAT or record.get("to") != "mjcf":
        raise ConfigError(f"{str(path)!r} is not the record of a scene in MJCF; use graspbox export-scene --to mjcf")
    return record


def load_export(folder: str | os.PathLike[str]) -> ExportedScene:
    """Load an exported MJCF scene only from its files.

    Raises
    ------
    FileError
        If a file is missing or cannot be read.
    ConfigError
        If they are not those of an export, or MuJoCo does not accept them.
    """
    folder = Path(folder)
    record = _record(folder)
    if "hand" not in record:
        raise ConfigError(f"the scene in {str(folder)!r} has no hand; export it with a grasp")
    urdf, toml = (read_bounded(folder / name, _MAX_BYTES).decode() for name in ("hand.urdf", "hand.toml"))
    hand = description.describe(Hand(urdf, toml))
    path = folder / "scene.xml"
    if not path.is_file():
        raise FileError(2, "No such file", str(path))
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ConfigError(f"MuJoCo does not accept {str(path)!r}: {' '.join(str(error).split())}") from None
    # The start is the file's keyframe: these facts are only for reports.
    facts = record["objects"] if "objects" in record else [record["object"]]
    items = []
    for label, fact in zip(object_names(len(facts)), facts, strict=True):
        body = model.body(label)
        mass, inertia = float(body.mass[0]), np.diag(body.inertia)
        items.append(ObjectData(str(fact["name"]), (), mass, body.ipos, inertia, np.eye(4)))
    numerics = replace(Numerics(), timestep=float(model.opt.timestep))
    return ExportedScene(indexed(model, hand, items, numerics), float(record["hand"]["preshape"]))


class ExportedReplay(Replay):
    """A trial in an exported scene: it begins at the keyframe of the file."""

    def __init__(self, exported: ExportedScene, times: TrialTimes | None = None):
        super().__init__(exported.scene, np.eye(4), exported.preshape, times)

    def _place(self, world_from_hand: Array) -> None:
        model = self.model
        # The trial prescribes the carriage, as in the judge's own model.
        model.opt.disableactuator |= 1 << LIFT_GROUP
        mujoco.mj_resetDataKeyframe(model, self.data, model.key(KEYFRAME).id)


def replay_export(folder: str | os.PathLike[str], times: TrialTimes | None = None) -> Outcome:
    """Run the trial of an exported MJCF scene in MuJoCo; raises as `load_export`."""
    return run_trial(ExportedReplay(load_export(folder), times))


@dataclass(frozen=True)
class ExportRow:
    """One trial: the labels of the judge's model, of the exported file and of the core."""

    #: The object that the grasp is for.
    object: str
    judge: Outcome
    exported: Outcome
    core: bool
    #: Of several objects: the greatest distance that one of them moves at rest, without a hand, in `REST` seconds; m.
    drift: float | None = None

    @property
    def equal(self) -> bool:
        """Whether judge and file have the same label."""
        return self.judge.success == self.exported.success

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON types."""
        labels = {"judge": self.judge, "exported": self.exported}
        return {
            "object": self.object,
            "core": self.core,
            **{name: outcome.failure or "success" for name, outcome in labels.items()},
            **{f"{name}_lift": outcome.lift for name, outcome in labels.items()},
        }


@dataclass
class ExportReport(Agreement):
    """Results of `compare_exports`."""

    rows: list[ExportRow] = field(default_factory=list)
    #: Objects with too few feasible poses.
    left_out: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON types."""
        return {
            "mujoco_version": MUJOCO_VERSION,
            "trials": len(self.rows),
            "equal": self.equal,
            "share": self.share,
            "equal_to_core": sum(row.core == row.exported.success for row in self.rows),
            "greatest_drift": max((row.drift for row in self.rows if row.drift is not None), default=None),
            "same_failure": sum(row.judge.failure == row.exported.failure for row in self.rows),
            "greatest_lift_difference": max((abs(r.judge.lift - r.exported.lift) for r in self.rows), default=0.0),
            "successes": {
                "judge": sum(row.judge.success for row in self.rows),
                "exported": sum(row.exported.success for row in self.rows),
                "core": sum(row.core for row in self.rows),
            },
            "left_out": self.left_out,
            "different": [row.to_json() for row in self.rows if not row.equal],
        }


def compare_exports(
    objects: Sequence[str] | None = None,
    trials: int = 200,
    seed: int = 0,
    *,
    source: Source = "planner-any",
    layout: SceneLayout = "single",
    count: int = 5,
    hand: HandLike = "reflex",
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ExportReport:
    """Export the scene of each trial, replay it from its files, and compare with the judge's own replay.

    Parameters
    ----------
    objects : sequence of str, optional
        Object sets: the trials are distributed evenly over their objects, or each scene of a layout draws its objects
        from them. By default `EXPORT_OBJECTS`, or `HEAPED` for a layout.
    trials, seed : int
        Number of trials, at least 1, and seed of the poses or of the first scene.
    source : str
        Source of the poses of single objects; see `sampling.Source`.
    layout : str
        With a layout other than ``single``, trials are the planner's best grasp of each object of scenes of several. A
        trial succeeds, in both engines, if the hand holds any object.
    count : int
        Number of objects wanted in each scene of a layout, 1 or more.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    threads : int, optional
        Number of threads; by default that of the core.
    progress : callable, optional
        Called after each trial with the number of finished ones.

    Raises
    ------
    ConfigError
        If there are no trials.
    """
    check_settings(trials, Numerics())
    loaded, report = load_hand(hand), ExportReport()
    with ThreadPoolExecutor(threads or _core.num_threads()) as pool:
        if layout == "single":
            cases = scenes(objects or EXPORT_OBJECTS, trials, seed, loaded)
            rows = _single_rows(cases, source, pool, threads, report.left_out)
        else:
            heaps = targets(objects or (HEAPED,), layout, (trials, count), loaded, 1, seed)
            rows = _heap_rows(islice(heaps, trials), pool, loaded)
        for row in rows:
            report.rows.append(row)
            if progress is not None:
                progress(len(report.rows))
    return report


def _single_rows(
    cases: Iterable[tuple[graspbox.Scene, int, np.random.Generator]],
    source: Source,
    pool: ThreadPoolExecutor,
    threads: int | None,
    left_out: list[str],
) -> Iterator[ExportRow]:
    """Yield the trials of single objects; appends those with too few feasible poses to `left_out`."""
    for scene, count, random in cases:
        sampled = sample_trials(scene, count, random, source)
        if sampled is None:
            left_out.append(scene.name)
            continue
        own = build(describe(scene.hand), object_data(scene))
        core = scene.simulate(*sampled, num_threads=threads).success
        for success, outcomes in zip(core, pool.map(partial(_both, scene, own), *sampled), strict=True):
            yield ExportRow(scene.name, *outcomes, bool(success))


def _heap_rows(
    cases: Iterable[tuple[Arrangement, int, graspbox.Plan]], pool: ThreadPoolExecutor, hand: graspbox.Hand
) -> Iterator[ExportRow]:
    """Yield the trials of the objects of heaps, with the drift of each heap."""
    described, drifts = describe(hand), {}

    def run(heap: Arrangement, target: int, plan: graspbox.Plan) -> tuple[ExportRow, Arrangement]:
        scene = graspbox.Scene.of(heap, hand=hand)
        own = build_heap(described, objects_of(scene), walls_of(scene))
        world_from_hand = heap.world_from_objects[target] @ plan.poses[0]
        pose, preshape = np.linalg.inv(scene.world_from_object) @ world_from_hand, float(plan.preshape[0])
        core = scene.simulate(pose[None], preshape, num_threads=1).success
        return ExportRow(heap.meshes[target].name, *_both(scene, own, pose, preshape), bool(core[0])), heap

    for row, heap in pool.map(lambda case: run(*case), cases):
        if id(heap) not in drifts:
            drifts[id(heap)] = drift_at_rest(graspbox.Scene.of(heap, hand=hand))
        yield replace(row, drift=drifts[id(heap)])


def _both(scene: graspbox.Scene, own: Scene, pose: Array, preshape: float) -> tuple[Outcome, Outcome]:
    """Replay a trial in the judge's own model, and from the files of its export."""
    judge = replay(own, scene.world_from_object @ pose, float(preshape))
    with tempfile.TemporaryDirectory() as folder:
        export_scene(scene, Path(folder) / "scene", "mjcf", pose, float(preshape))
        return judge, replay_export(Path(folder) / "scene")


def drift_at_rest(scene: graspbox.Scene, seconds: float = REST) -> float:
    """Export a scene without a hand, step it in MuJoCo, and return the greatest distance that an object moves, metres.

    Objects of the core are up to half a millimetre deep in each other, which MuJoCo resolves.
    """
    with tempfile.TemporaryDirectory() as folder:
        export_scene(scene, Path(folder) / "scene", "mjcf")
        model = mujoco.MjModel.from_xml_path(str(Path(folder) / "scene" / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(KEYFRAME).id)
    start = data.qpos.reshape(-1, 7)[:, :3].copy()
    while data.time < seconds:
        mujoco.mj_step(model, data)
    return float(np.linalg.norm(data.qpos.reshape(-1, 7)[:, :3] - start, axis=1).max())
