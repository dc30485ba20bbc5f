"""Robust success: the success rate of perturbed copies of a grasp, in both engines.

Rounding decides a single trial close to the limit of success. The success rate of slightly translated and rotated
copies is a property of the grasp and can be compared between engines: by Spearman's rank correlation over many grasps,
and by the mean difference. The core is also compared with itself at half its time step on the same copies, which bounds
the agreement to expect.

Results of finished objects can be saved to a file, from which an interrupted run resumes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import graspbox
from graspbox import _core
from graspbox._common.files import read_bounded, write_text
from graspbox._common.runs import refuse_changes
from graspbox.errors import ConfigError, FileError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.description import Array, HandDescription
from graspbox.tools.scene_export.contents import object_data
from validation.agreement import kappa, spearman
from validation.mujoco.compare import (
    PLANNER_OBJECTS,
    check_settings,
    describe,
    halve,
    replay_all,
    scenes,
)
from validation.mujoco.sampling import Source, perturbed, sample_trials
from validation.mujoco.scene import Numerics
from validation.versions import MUJOCO_VERSION

#: Largest file of finished objects to read, bytes.
_GREATEST_FILE = 1 << 26


@dataclass(frozen=True)
class Perturbation:
    """Number and size of a grasp's perturbations.

    Attributes
    ----------
    replays : int
        Number of copies of each grasp.
    shift, turn : float
        Greatest distance (m) and angle (rad); see `sampling.perturbed`.
    """

    replays: int = 16
    shift: float = 0.005
    turn: float = float(np.deg2rad(5.0))


@dataclass(frozen=True)
class RobustRow:
    """Results for the copies of one grasp.

    Attributes
    ----------
    object : str
        Name of the object.
    core, core_half, mujoco : list of bool
        Success of each copy in the core, in the core at half its time step, and in MuJoCo. Copies in collision at the
        start fail.
    """

    object: str
    core: list[bool]
    core_half: list[bool]
    mujoco: list[bool]


@dataclass(frozen=True)
class RobustReport:
    """Results for all grasps."""

    rows: list[RobustRow]
    #: Objects without enough feasible poses.
    left_out: list[str]

    def shares(self) -> dict[str, Array]:
        """Return the success rate of the copies, by engine; one entry per grasp."""
        names = ("core", "core_half", "mujoco")
        return {name: np.array([np.mean(getattr(row, name)) for row in self.rows]) for name in names}

    def facts(self) -> dict[str, Any]:
        """Return the statistics of the comparison as JSON types."""
        facts: dict[str, Any] = {"grasps": len(self.rows), "left_out": self.left_out}
        if not self.rows:
            return facts
        shares = self.shares()
        labels = {name: np.array([x for row in self.rows for x in getattr(row, name)], dtype=bool) for name in shares}
        facts["replays"] = len(labels["core"])
        facts["mean_share"] = {name: float(share.mean()) for name, share in shares.items()}
        for first, second in (("core", "mujoco"), ("core", "core_half")):
            difference = shares[first] - shares[second]
            facts[f"{first} / {second}"] = {
                # The correlation is undefined if all rates are equal, and JSON has no NaN.
                "spearman": None if np.isnan(order := spearman(shares[first], shares[second])) else order,
                "bias": float(difference.mean()),
                "bias_standard_error": float(difference.std() / np.sqrt(len(difference))),
                "mean_difference": float(np.abs(difference).mean()),
                "equal": float(np.mean(labels[first] == labels[second])),
                "kappa": kappa(labels[first], labels[second]),
            }
        return facts

    def to_json(self) -> dict[str, Any]:
        """Return the values as JSON types."""
        return {"mujoco_version": MUJOCO_VERSION, **self.facts(), "rows": [asdict(row) for row in self.rows]}


def _try(
    scene: graspbox.Scene,
    hand: HandDescription,
    sampled: tuple[Array, Array],
    how: Perturbation,
    random: np.random.Generator,
    numerics: Numerics,
    threads: int,
) -> list[RobustRow]:
    """Replay all grasps of one object."""
    poses = np.concatenate([perturbed(pose, how.replays, how.shift, how.turn, random) for pose in sampled[0]])
    preshapes = np.repeat(sampled[1], how.replays)
    ours = scene.simulate(poses, preshapes, num_threads=threads)
    half = halve(scene).simulate(poses, preshapes, num_threads=threads).success
    # Copies in collision in the core count as failed in both engines and are not replayed.
    free = np.array(ours.failure) != "infeasible"
    theirs = np.zeros(len(poses), dtype=bool)
    item = object_data(scene)
    worlds = item.world_from_object @ poses[free]
    replays = replay_all(hand, item, worlds, preshapes[free], numerics, threads, early_stop=True)
    theirs[free] = [outcome.success for outcome in replays]
    columns = [np.asarray(column).reshape(-1, how.replays).tolist() for column in (ours.success, half, theirs)]
    return [RobustRow(scene.name, core, fine, mujoco) for core, fine, mujoco in zip(*columns, strict=True)]


def _load(path: Path | None, settings: dict[str, Any]) -> dict[str, list[RobustRow]]:
    """Load the finished objects of an interrupted run with the same settings."""
    if path is None or not path.exists():
        return {}
    try:
        saved = json.loads(read_bounded(path, _GREATEST_FILE))
        rows = {name: [RobustRow(**row) for row in entries] for name, entries in saved["objects"].items()}
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(
            22, f"not the results of a robust comparison ({error}); give another file", str(path)
        ) from error
    refuse_changes(path, saved["settings"], settings, "give another file")
    return rows


def compare_robust(
    objects: Sequence[str] = PLANNER_OBJECTS,
    grasps: int = 200,
    seed: int = 0,
    *,
    source: Source = "planner-any",
    how: Perturbation | None = None,
    hand: HandLike = "reflex",
    threads: int | None = None,
    numerics: Numerics | None = None,
    resume: Path | None = None,
    progress: Callable[[int], None] | None = None,
) -> RobustReport:
    """Replay `grasps` grasps, distributed evenly over the objects, with perturbations in both engines.

    Parameters
    ----------
    objects : sequence of str
        Object sets.
    grasps : int
        Number of grasps, at least one.
    seed : int
        Seed of poses and perturbations.
    source, hand, threads, numerics
        As for `validation.mujoco.compare`.
    how : Perturbation, optional
        Number and size of the perturbations.
    resume : Path, optional
        File for results of finished objects; objects that it contains already are skipped.
    progress : callable, optional
        Called after each object with the number of finished grasps.

    Raises
    ------
    ConfigError
        If there are no grasps or replays, a perturbation is negative, or `resume` holds results of other settings.
    FileError
        If `resume` cannot be read or written.
    """
    numerics, how = numerics or Numerics(), how or Perturbation()
    check_settings(grasps, numerics)
    if how.replays < 1 or how.shift < 0.0 or how.turn < 0.0:
        raise ConfigError(f"{how} is out of range; give at least 1 replay, and no negative shift or turn")
    loaded = load_hand(hand)
    described = describe(loaded)
    settings = {
        "grasps": grasps,
        "mujoco_version": MUJOCO_VERSION,
        "seed": seed,
        "source": source,
        "hand": loaded.name,
        "objects": list(objects),
        "how": asdict(how),
        "numerics": json.loads(json.dumps(asdict(numerics))),
    }
    finished = _load(resume, settings)
    left_out: list[str] = []
    done = 0
    for scene, count, random in scenes(objects, grasps, seed, loaded):
        if scene.name not in finished:
            sampled = sample_trials(scene, count, random, source)
            if sampled is None:
                left_out.append(scene.name)
            else:
                workers = threads or _core.num_threads()
                finished[scene.name] = _try(scene, described, sampled, how, random, numerics, workers)
                if resume is not None:
                    kept = {name: [asdict(row) for row in rows] for name, rows in finished.items()}
                    write_text(resume, json.dumps({"settings": settings, "objects": kept}))
        done += count
        if progress is not None:
            progress(done)
    return RobustReport([row for rows in finished.values() for row in rows], left_out)
