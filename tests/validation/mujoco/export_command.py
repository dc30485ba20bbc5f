"""``python tests/validate.py export``: the labels of exported MJCF scenes and of the judge's own replay.

Each trial is exported as MJCF, loaded from its files by MuJoCo, and replayed with the drives of the judge. It fails if
less than 99 % of the labels are equal. With a layout, trials are the planner's best grasps of every object of scenes of
several, and it fails, too, if an object of a scene moves by more than 3 mm while it is at rest.
"""

from __future__ import annotations

import argparse
from typing import get_args

from rich.console import Console
from rich.table import Table

from graspbox.simulation.layouts import SceneLayout
from validation import options
from validation.engines import HEAPED
from validation.mujoco.exported import ExportReport, compare_exports
from validation.versions import judged_by

#: Least share of equal labels for exit status 0.
GOAL = 0.99
#: Greatest drift of an object at rest for exit status 0, metres.
DRIFT = 0.003


def _parser() -> argparse.ArgumentParser:
    parser = options.make_parser("export", __doc__)
    parser.add_argument("--trials", type=int, default=200, help="trials (200)")
    parser.add_argument("--objects", nargs="+", metavar="SET", help=f"object sets; of a layout by default {HEAPED}")
    parser.add_argument("--layout", default="single", choices=get_args(SceneLayout), help="how several objects lie")
    parser.add_argument("--count", type=int, default=5, help="objects per scene of a layout (5)")
    parser.add_argument("--hand", default="reflex", help="name of the hand (reflex)")
    parser.add_argument(
        "--source",
        choices=("random", "planner", "planner-any"),
        default="planner-any",
        help="poses of single objects: random, the planner's best, or a random choice of the planner's (planner-any)",
    )
    return parser


def _print(console: Console, report: ExportReport) -> None:
    console.print(judged_by())
    facts = report.to_json()
    if facts["different"]:
        table = Table("object", "judge", "exported", "judge lift", "exported lift", "core", title="differences")
        for row in facts["different"]:
            lifts = (f"{row['judge_lift']:.3f}", f"{row['exported_lift']:.3f}")
            table.add_row(row["object"], row["judge"], row["exported"], *lifts, "success" if row["core"] else "failure")
        console.print(table)
    counts = ", ".join(f"{name} {count}" for name, count in facts["successes"].items())
    console.print(f"equal labels: {report.equal} of {len(report.rows)} ({report.share:.1%}); successes: {counts}")
    console.print(f"exported and core: {facts['equal_to_core']} of {len(report.rows)} labels are equal")
    if facts["greatest_drift"] is not None:
        console.print(f"greatest drift at rest in 1 s: {1e3 * facts['greatest_drift']:.2f} mm")
    console.print(f"greatest difference of lifts: {1e3 * facts['greatest_lift_difference']:.3f} mm")
    if report.left_out:
        console.print(f"without enough feasible poses: {', '.join(report.left_out)}")


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; returns exit status 0 if it meets its goal, else 1."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.count < 1:
        parser.error(f"--count is {args.count}; give 1 or more")
    how = {"source": args.source, "layout": args.layout, "count": args.count}
    report = options.compare(args, "trials", args.trials, compare_exports, args.objects, args.trials, **how)
    options.print_report(args, report, _print)
    drift = max((row.drift for row in report.rows if row.drift is not None), default=0.0)
    return 0 if report.rows and report.share >= GOAL and drift <= DRIFT else 1
