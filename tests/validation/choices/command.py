"""``python tests/validate.py choices``: MuJoCo judges the grasps that policies choose.

Every policy acts in seeded trials of the core, with its own hand; each grasp is replayed in MuJoCo. All trials count:
one without a grasp, or whose open hand is in collision, is a failure. With --patch MuJoCo's contacts resist turning
about their normal, as soft pads do; as points they let an object between two of them swing. Exit status: 0 if the
success rates of both engines differ by at most 3 points for every policy and object set, else 1.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from rich.console import Console
from rich.progress import Progress, TaskID
from rich.table import Table

from graspbox import object_sets
from graspbox.data.trials.learned import evaluated_split
from graspbox.evaluation.results import wilson
from validation.choices import ChoicesReport, compare_choices
from validation.mujoco import Numerics
from validation.options import make_parser, progress_bar
from validation.versions import judged_by

#: Objects from which no published policy learned.
_OBJECTS = ("procedural:unseen:0-19", "ycb")
#: Greatest difference of the success rates for exit status 0.
_BIAS = 0.03


def _parser() -> argparse.ArgumentParser:
    parser = make_parser("choices", __doc__)
    parser.add_argument("policies", nargs="+", metavar="POLICY", help="policies, by name or folder")
    parser.add_argument("--objects", nargs="+", default=list(_OBJECTS), metavar="SET", help="object sets")
    parser.add_argument("--trials", type=int, default=200, help="trials of each policy on each object set (200)")
    parser.add_argument("--rehearse", type=int, default=None, help="grasps that the policies rehearse")
    step = Numerics().timestep
    parser.add_argument("--timestep", type=float, default=step, help=f"MuJoCo's time step, s ({step})")
    parser.add_argument(
        "--patch", type=float, default=0.0, help="mean radius of contact areas in MuJoCo, mm (0: points)"
    )
    return parser


def _print(console: Console, reports: Sequence[tuple[str, ChoicesReport]]) -> None:
    table = Table("policy", "hand", "objects", "trials", "core", "MuJoCo", "points", "equal labels", "no grasp")
    for objects, report in reports:
        rates = []
        for count in report.successes().values():
            low, high = wilson(count, report.trials)
            rates.append(f"{count / report.trials:.1%} ({low:.1%} to {high:.1%})")
        rows = report.compared
        table.add_row(
            report.policy,
            report.hand,
            objects,
            str(report.trials),
            *rates,
            f"{100 * report.difference:+.1f}",
            f"{rows.equal} of {len(rows.rows)}",
            str(report.missing),
        )
    console.print(table)


def _advance(bar: Progress, task: TaskID, done: int) -> None:
    bar.update(task, completed=done)


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; returns the exit status."""
    args = _parser().parse_args(arguments)
    numerics = replace(Numerics(), timestep=args.timestep)
    reports: list[tuple[str, ChoicesReport]] = []
    with progress_bar(args) as bar:
        for policy in args.policies:
            for objects in args.objects:
                name, split = object_sets.name_and_split(objects)
                task = bar.add_task(f"{policy}, {objects}", total=args.trials)
                report = compare_choices(
                    policy,
                    object_sets.load(name, split=split or evaluated_split(name)),
                    args.trials,
                    args.seed,
                    rehearsed=args.rehearse,
                    threads=args.threads,
                    numerics=numerics,
                    patch=args.patch * 1e-3,
                    progress=partial(_advance, bar, task),
                )
                reports.append((objects, report))
    if args.json:
        print(json.dumps([{"objects": objects, **report.to_json()} for objects, report in reports]))
    else:
        _print(Console(), reports)
        print(judged_by())
    return 0 if all(abs(report.difference) <= _BIAS for _, report in reports) else 1
