"""``python tests/validate.py forces``: judge grasps by six forces and a lift, as DexGraspBench does.

Grasps come from the planner (default), from files, or from policies. A grasp passes *six forces* if no pull of
10 m/s2 times the mass moves the object by 5 cm or 15 degrees since before the hand closed; *held* counts the motion
since the hand closed. *lift* is the same for a lift of 10 cm off the table. With --dexgraspbench the benchmark's own
example grasps are judged in MuJoCo, with its own hand and objects. Exit status: 0 if grasps were judged (and at least
95 % of the verdicts stored in the checkout, if there are any, are equal), else 1.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rich.progress import Progress, TaskID

from graspbox import _core
from graspbox.configs import PhysicsConfig
from graspbox.evaluation.results import wilson
from graspbox.simulation import Scene
from validation.engines import DEFAULT_OBJECTS
from validation.forces.config import ForceConfig, Verdict
from validation.forces.core import judge_in_core
from validation.forces.report import SourceResult, markdown, to_json
from validation.forces.sources import Batch, chosen, from_files, planned
from validation.options import make_parser, progress_bar
from validation.versions import MUJOCO_VERSION, judged_by

__all__ = ["ENGINES", "judge", "main"]

#: Engines that judge.
ENGINES = ("implicit", "rapier", "mujoco")
#: Objects for policies: those that no published policy has seen.
_UNSEEN = ("procedural:unseen:0-19",)
#: Least share of equal verdicts for exit status 0 where the checkout knows its own.
_GOAL = 0.95


def judge(batch: Batch, engine: str, config: ForceConfig, threads: int) -> list[Verdict]:
    """Judge the grasps of a batch with one of `ENGINES`."""
    if engine == "mujoco":
        from validation.forces.in_mujoco import judge_in_mujoco

        return list(judge_in_mujoco(batch.scene, batch.poses, batch.preshape, config, threads))
    scene = batch.scene
    if scene.physics.engine != engine:
        physics = PhysicsConfig(engine=engine)  # type: ignore[arg-type]
        rest = scene.world_from_object
        scene = Scene(scene.mesh, hand=scene.hand, world_from_object=rest, physics=physics)
    return judge_in_core(scene, batch.poses, batch.preshape, config, threads)


def _parser() -> argparse.ArgumentParser:
    parser = make_parser("forces", __doc__)
    parser.add_argument("--objects", nargs="+", metavar="SET", help="object sets (6 procedural; for policies, unseen)")
    parser.add_argument("--hand", default="reflex", help="hand of the planner or of the files (reflex)")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--poses", type=int, default=5, help="grasps of the planner for each object (5)")
    source.add_argument(
        "--grasps", nargs="+", type=Path, metavar="FILE", help="files that graspbox.tools.exchange reads"
    )
    source.add_argument("--policies", nargs="+", metavar="NAME", help="policies, each with its own rate")
    source.add_argument(
        "--dexgraspbench", type=Path, metavar="CHECKOUT", help="example grasps of its Shadow hand; trust them"
    )
    parser.add_argument("--preshape", type=float, default=None, help="preshape of files that have none, rad or index")
    parser.add_argument("--trials", type=int, default=100, help="trials of each policy (100)")
    parser.add_argument(
        "--engines", nargs="+", choices=ENGINES, default=["implicit", "mujoco"], help="(implicit mujoco)"
    )
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Judge grasps; returns the exit status."""
    parser = _parser()
    args = parser.parse_args(arguments)
    for name in ("poses", "trials", "threads"):
        if getattr(args, name) is not None and getattr(args, name) < 1:
            parser.error(f"--{name} is {getattr(args, name)}; give 1 or more")
    if args.seed < 0:
        parser.error(f"--seed is {args.seed}; give 0 or more")
    threads = args.threads or _core.num_threads()
    with progress_bar(args) as bar:
        if args.dexgraspbench is not None:
            return _examples(args, threads, bar)
        rows = to_json(_policies(args, threads, bar) if args.policies else _grasps(args, threads, bar))
    print(json.dumps([{**row, "mujoco_version": MUJOCO_VERSION} for row in rows]) if args.json else markdown(rows))
    if not args.json:
        print(judged_by())
    return 0 if any(facts["grasps"] for row in rows for facts in row["engines"].values()) else 1


def _judged(
    result: SourceResult, batches: Sequence[Batch], args: argparse.Namespace, threads: int, done: Callable[[], None]
) -> SourceResult:
    for engine in args.engines:
        result.verdicts[engine] = []
    for batch in batches:
        for engine in args.engines:
            result.verdicts[engine] += judge(batch, engine, ForceConfig(), threads)
        done()
    return result


def _grasps(args: argparse.Namespace, threads: int, bar: Progress) -> list[SourceResult]:
    """Judge grasps of the planner or of files."""
    objects = args.objects or list(DEFAULT_OBJECTS)
    from_disk = from_files(args.grasps, objects, args.hand, args.preshape) if args.grasps else None
    batches = list(planned(objects, args.poses, args.seed, args.hand) if from_disk is None else from_disk)
    task = bar.add_task("objects", total=len(batches))
    name = "planner" if from_disk is None else "files"
    return [_judged(SourceResult(name), batches, args, threads, partial(bar.advance, task))]


def _policies(args: argparse.Namespace, threads: int, bar: Progress) -> list[SourceResult]:
    """Judge what policies choose in their own trials."""
    results = []
    for name in args.policies:
        task = bar.add_task(f"trials of {name}", total=args.trials)
        choices = chosen(name, args.objects or _UNSEEN, args.trials, args.seed, _completing(bar, task))
        batches = [batch for batch in choices.batches if batch is not None]
        trials = choices.result.trials
        own = sum(trial.success for trial in trials), sum(trial.secure for trial in trials)
        result = SourceResult(name, missing=len(choices.batches) - len(batches), own=own)
        task = bar.add_task(f"grasps of {name}", total=len(batches))
        results.append(_judged(result, batches, args, threads, partial(bar.advance, task)))
    return results


def _completing(bar: Progress, task: TaskID) -> Callable[[int], None]:
    """Return a function that updates a progress bar."""
    return lambda done: bar.update(task, completed=done)


def _examples(args: argparse.Namespace, threads: int, bar: Progress) -> int:
    """Judge the example grasps of a checkout."""
    from validation.forces.checkout import Checkout, judge_examples

    checkout = Checkout(args.dexgraspbench)
    task = bar.add_task("example grasps", total=len(checkout.grasps))
    report = judge_examples(checkout, threads, progress=_completing(bar, task))
    bar.stop()
    facts = report.to_json()
    equal, compared = facts["equal"], facts["compared"]
    if args.json:
        print(json.dumps(facts))
    else:
        low, high = wilson(report.passed, len(report.rows))
        share = f"{100 * report.passed / len(report.rows):.1f} % ({100 * low:.1f} to {100 * high:.1f})"
        print(f"example grasps that pass six forces: {report.passed} of {len(report.rows)}, {share}")
        stored = f"{equal} of {compared} verdicts stored in the checkout are equal"
        nothing = "the checkout has no evaluation to compare with; `bash script/example.sh` in it makes one"
        print(stored if compared else nothing)
        print(judged_by())
    return 0 if not compared or equal >= _GOAL * compared else 1
