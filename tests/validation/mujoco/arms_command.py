"""``python tests/validate.py arms``: arms in the environments and in MuJoCo, their paths and their grasps.

Exit status: 0 if every flange is within 1 mm and 0.5 degrees along all paths, and 97 % of the grasps by whole arms have
the same verdict; else 1. Of the grasps, half fail in the core, if so many are found: of grasps that nearly all hold,
any two engines agree. With --first they are the planner's best that the arm executes, as they come. With --patch
MuJoCo's contacts resist turning about their normal, as soft pads do; as points they let an object swing.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress, TaskID
from rich.table import Table

from validation.mujoco.arm_verdicts import SAME, VerdictReport, compare_arm
from validation.mujoco.arms import ANGLE, DISTANCE, ArmRow, follow_paths
from validation.options import make_parser, progress_bar
from validation.versions import MUJOCO_VERSION, judged_by

#: The included arms that carry the hand of the paths, and the hands with which they grasp.
_HANDS = {"fr3": "panda_gripper", "ur5e": "robotiq_2f_85", "xarm7": "reflex"}
#: The hand of other arms, and the objects of the grasps.
_HAND, _OBJECTS = "panda_gripper", ("procedural:unseen:0-19",)

R = TypeVar("R")


def main(arguments: Sequence[str] | None = None) -> int:
    """Follow paths, and execute grasps; returns 1 if a flange is elsewhere, or too many verdicts differ."""
    parser = make_parser("arms", __doc__)
    parser.add_argument(
        "--arm", action="append", help="an arm by its name; repeatable; by default " + ", ".join(_HANDS)
    )
    parser.add_argument("--paths", type=int, default=34, help="paths per arm (34); 0 for none")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a path (4)")
    parser.add_argument("--trials", type=int, default=100, help="grasps per arm (100); 0 for none")
    parser.add_argument("--objects", nargs="+", default=list(_OBJECTS), metavar="SET", help="object sets of the grasps")
    parser.add_argument("--first", action="store_true", help="the planner's best grasps, whether they hold or not")
    parser.add_argument(
        "--patch", type=float, default=0.0, help="mean radius of contact areas in MuJoCo, mm (0: points)"
    )
    args = parser.parse_args(arguments)
    names = args.arm or list(_HANDS)
    with progress_bar(args) as bar:
        rows = _each(bar, names, "paths", args.paths, partial(_paths, args))
        reports = _each(bar, names, "grasps", args.trials, partial(_grasps, args))
    if args.json:
        facts = {"paths": [row.to_json() for row in rows], "grasps": [report.to_json() for report in reports]}
        print(json.dumps({"mujoco_version": MUJOCO_VERSION, **facts}))
    else:
        _show(args, rows, reports)
    return 0 if all(row.agrees for row in rows) and _share(reports) >= SAME else 1


def _each(
    bar: Progress, names: Sequence[str], unit: str, count: int, run: Callable[[str, Callable[[int], None]], R]
) -> list[R]:
    """Run a comparison for each arm, unless there is nothing to compare."""
    if count == 0:
        return []
    task, results = bar.add_task(unit, total=len(names) * count), list[R]()
    for index, name in enumerate(names):
        results.append(run(name, partial(_advance, bar, task, index * count)))
    return results


def _advance(bar: Progress, task: TaskID, before: int, done: int) -> None:
    bar.update(task, completed=before + done)


def _paths(args: argparse.Namespace, name: str, progress: Callable[[int], None]) -> ArmRow:
    return follow_paths(name, args.paths, args.seconds, args.seed, progress)


def _grasps(args: argparse.Namespace, name: str, progress: Callable[[int], None]) -> VerdictReport:
    hand = _HANDS.get(name, _HAND)
    how = {"first": args.first, "threads": args.threads, "patch": args.patch * 1e-3}
    return compare_arm(name, hand, args.objects, args.trials, args.seed, **how, progress=progress)


def _share(reports: Sequence[VerdictReport]) -> float:
    """Return the share of all trials with the same verdict; 1 without trials."""
    trials = sum(len(report.rows) for report in reports)
    return sum(report.equal for report in reports) / trials if trials else 1.0


def _show(args: argparse.Namespace, rows: Sequence[ArmRow], reports: Sequence[VerdictReport]) -> None:
    console = Console()
    for row in rows:
        console.print(
            f"{row.arm}: {row.paths} paths of {args.seconds:g} s, {row.travel:.2f} m each; flange within "
            f"{1e3 * row.distance:.3f} mm and {row.angle:.3f} degrees of MuJoCo's"
        )
    if rows:
        console.print(f"both agree: within {1e3 * DISTANCE:g} mm and {ANGLE:g} degrees")
    if reports:
        _show_grasps(console, reports)
    console.print(judged_by())


def _show_grasps(console: Console, reports: Sequence[VerdictReport]) -> None:
    table = Table("arm, hand", "MuJoCo", "both hold", "core only", "MuJoCo only", "neither", "same", title="grasps")
    for report in reports:
        facts = report.to_json()
        for name, title in (("arm", "whole arm"), ("free", "hand alone")):
            share = facts["agreements"][f"core / {name}"]["share"]
            counts = map(str, facts["confusion"][name].values())
            table.add_row(f"{report.arm}, {report.hand}", title, *counts, f"{share:.1%}")
    console.print(table)
    for report in reports:
        facts = report.to_json()
        causes = ", ".join(f"{count} by the {cause}" for cause, count in facts["by_cause"].items())
        console.print(
            f"{report.arm}: different {causes}; whole arm and hand alone in MuJoCo equal: "
            f"{facts['agreements']['free / arm']['share']:.1%}; of grasps as they come {report.unselected:.1%} same; "
            f"flange within {1e3 * facts['distance']:.2f} mm, {facts['angle']:.2f} degrees; torques up to "
            f"{facts['torque']:.0%}; links touched something in {facts['touched']} trials"
        )
    console.print(f"same verdict: {_share(reports):.1%} (goal: {SAME:.0%})")
