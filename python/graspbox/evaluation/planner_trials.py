"""Trials of planned poses over an object set, for ``graspbox grasp``."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from graspbox import _core
from graspbox._common.refusals import is_refusal, reason
from graspbox.configs import PhysicsConfig, PlanConfig, TrialConfig
from graspbox.errors import GraspboxError
from graspbox.hands import HandLike
from graspbox.object_sets import ObjectSet, ObjectSpec
from graspbox.planning import Plan, plan
from graspbox.planning.plan_files import grasp_rows
from graspbox.simulation import Outcomes, Scene

__all__ = ["ObjectResult", "SetResult", "try_object", "try_set"]


@dataclass(frozen=True)
class ObjectResult:
    """Result of one object.

    Attributes
    ----------
    plan : Plan or None
        The poses tried, in ranking order; None if the object could not be prepared.
    seconds : float
        Wall time of the trials, without preparation and planning.
    shaken : bool
        Whether the trials included a shake.
    error : str
        Why the object could not be prepared, planned for or simulated; empty if it could.
    """

    name: str
    plan: Plan | None = None
    outcomes: Outcomes | None = None
    seconds: float = 0.0
    shaken: bool = False
    error: str = ""
    spec: ObjectSpec | None = None

    def row(self) -> dict[str, Any]:
        """Return the counts of trials that ``graspbox grasp --json`` prints."""
        out = self.outcomes

        def count(name: str) -> int:
            return 0 if out is None else int(getattr(out, name).sum())

        # Early stops may have prevented the study's measures; infeasible poses have none and count as failed.
        cut_off = out is not None and bool((np.isnan(out.kindness) & (out.failure != "infeasible")).any())
        return {
            "name": self.name,
            "tried": 0 if out is None else len(out),
            "succeeded": count("success"),
            "secure": count("secure"),
            "survived_shake": count("survives_shake") if self.shaken else None,
            "legacy_succeeded": None if cut_off else count("legacy_success"),
            "first_succeeded": bool(out and out.success[0]),
        }

    def details(self) -> dict[str, Any]:
        """Return counts, grasps and outcomes, as ``graspbox grasp --out`` writes them.

        In addition to the counts of `row`: ``source``, ``scale`` and ``mass`` of the object (`ObjectSpec`), ``error``
        (empty if none), ``hand``, ``sha256`` of the mesh (`graspbox.planning.plan_files.mesh_hash`),
        ``world_from_object`` (4x4) and ``grasps``, best first: ``object_from_hand`` (4x4), ``preshape``, ``feasible``,
        ``score``, ``box`` and ``face`` as in `graspbox.planning.plan_files`, and the fields of `graspbox.Outcome`, null
        for NaN. Metres, radians, seconds.
        """
        spec = self.spec or ObjectSpec(self.name)
        row = {**self.row(), "source": spec.source, "scale": spec.scale, "mass": spec.mass, "error": self.error}
        if self.plan is None or self.outcomes is None:
            return {**row, "hand": None, "world_from_object": None, "grasps": []}
        grasps = [
            {**grasp, **{key: None if value != value else value for key, value in vars(outcome).items()}}
            for grasp, outcome in zip(grasp_rows(self.plan), self.outcomes, strict=True)
        ]
        rest = self.plan.world_from_object.tolist()
        about = {"hand": self.plan.hand_name, "sha256": self.plan.mesh_sha256, "world_from_object": rest}
        return {**row, **about, "grasps": grasps}


@dataclass(frozen=True)
class SetResult:
    """Results of an object set."""

    objects: list[ObjectResult] = field(default_factory=list)

    def table(self, *, details: bool = False) -> dict[str, Any]:
        """Return totals and rows, as ``graspbox grasp --json`` prints them; with `details`, as ``--out`` writes them.

        ``rate`` is a share of the poses tried; ``first_rate`` and ``objects_with_success`` cover all objects of the
        set, and an object without a feasible pose counts as failed.
        """
        rows = [result.row() for result in self.objects]
        tried = sum(row["tried"] for row in rows)
        succeeded = sum(row["succeeded"] for row in rows)
        seconds = sum(result.seconds for result in self.objects)
        return {
            "objects": [result.details() for result in self.objects] if details else rows,
            "refused": {result.name: result.error for result in self.objects if result.error},
            "tried": tried,
            "succeeded": succeeded,
            "rate": succeeded / tried if tried else 0.0,
            "objects_with_success": sum(row["succeeded"] > 0 for row in rows),
            "first_rate": sum(row["first_succeeded"] for row in rows) / len(rows) if rows else 0.0,
            "trials_per_s": tried / seconds if seconds else 0.0,
        }


def try_object(
    spec: ObjectSpec,
    *,
    poses: int,
    seed: int = 0,
    hand: HandLike = "reflex",
    planning: PlanConfig = PlanConfig(),  # noqa: B008 (frozen)
    trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
) -> ObjectResult:
    """Let an object settle, plan for its resting pose, and try the best `poses` feasible poses.

    Errors of the object (a broken mesh, an object that rolls away) are reported in `ObjectResult.error`; others, such
    as a wrong setting, are raised.
    """
    try:
        scene = Scene(spec.load(), hand=hand, physics=physics)
        planned = plan(
            scene.mesh,
            hand=scene.hand,
            seed=seed,
            world_from_object=scene.world_from_object,
            config=planning,
            num_threads=num_threads,
        )
        best = planned.best(poses)
        started = time.perf_counter()
        outcomes = scene.simulate(best, config=trial, num_threads=num_threads)
        seconds = time.perf_counter() - started
    except GraspboxError as error:
        if not is_refusal(error):
            raise
        return ObjectResult(spec.name, shaken=trial.shake is not None, error=reason(error, spec.path), spec=spec)
    return ObjectResult(spec.name, best, outcomes, seconds, shaken=trial.shake is not None, spec=spec)


def try_set(objects: ObjectSet, *, done: Callable[[ObjectResult], None] = lambda _: None, **settings: Any) -> SetResult:
    """Evaluate every object of a set in order, with the settings of `try_object`; `done` is called with each result.

    An invalid ``GRASPBOX_THREADS`` is reported before any object is prepared.
    """
    if settings.get("num_threads") is None:
        _core.num_threads()
    results = SetResult()
    for spec in objects:
        results.objects.append(try_object(spec, **settings))
        done(results.objects[-1])
    return results
