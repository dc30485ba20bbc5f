"""``python tests/validate.py mujoco`` and ``planner``: print the agreement of MuJoCo and the core.

``mujoco`` tries random poses around objects. ``planner`` tries the planner's best poses for 20 YCB objects, and repeats
all trials of both engines at half their time step. Both fail if too few labels are equal, or if the success rates
differ too much.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rich.console import Console
from rich.table import Table

from validation import options
from validation.mujoco import DEFAULT_OBJECTS, PLANNER_OBJECTS, Numerics, Report, compare
from validation.mujoco.compare import Repeat
from validation.mujoco.sampling import Source
from validation.versions import judged_by


@dataclass(frozen=True)
class Check:
    """One of the comparisons."""

    #: Name on the command line.
    name: str
    source: Source
    objects: Sequence[str]
    trials: int
    #: Trials to repeat at half the time step, by default.
    repeat: Repeat
    #: Least share of equal labels, and greatest difference of the success rates, for exit status 0.
    goal: float
    bias: float


RANDOM = Check("mujoco", "random", DEFAULT_OBJECTS, 200, "different", goal=0.90, bias=0.04)
PLANNER = Check("planner", "planner", PLANNER_OBJECTS, 400, "all", goal=0.90, bias=0.04)


def _parser(check: Check) -> argparse.ArgumentParser:
    parser = options.make_parser(check.name, __doc__)
    parser.add_argument("--trials", type=int, default=check.trials, help=f"feasible grasps to label ({check.trials})")
    parser.add_argument("--objects", nargs="+", default=list(check.objects), metavar="SET", help="object sets")
    parser.add_argument("--hand", default="reflex", help="name of the hand (reflex)")
    step = Numerics().timestep
    parser.add_argument("--timestep", type=float, default=step, help=f"MuJoCo's time step, s ({step})")
    parser.add_argument(
        "--repeat",
        choices=("none", "different", "all"),
        default=check.repeat,
        help=f"trials to repeat at half the time step: those with different labels, or all ({check.repeat})",
    )
    return parser


def _print(console: Console, report: Report) -> None:
    console.print(judged_by())
    facts = report.to_json()
    table = Table(
        "object", "core", "MuJoCo", "core lift", "MuJoCo lift", "speed, mm/s", "links", "why", title="differences"
    )
    for row in report.rows:
        if not row.equal:
            m = row.mujoco
            labels = (row.failure or "success", m.failure or "success")
            numbers = (f"{row.lift:.3f}", f"{m.lift:.3f}", f"{m.speed * 1e3:.2f}")
            table.add_row(row.object, *labels, *numbers, f"{m.touching[0]} -> {m.touching[1]}", row.why or "")
    console.print(table)
    for title, key in (("core / MuJoCo", "by_kind"), ("why", "by_why"), ("object", "by_object")):
        counts = Table(title, "differences")
        for name, count in facts[key].items():
            counts.add_row(name, str(count))
        console.print(counts)
    pairs = Table("runs", "equal labels", "kappa")
    for name, agreement in facts["agreements"].items():
        pairs.add_row(name, f"{agreement['share']:.1%}", f"{agreement['kappa']:.2f}")
    console.print(pairs)
    rate = facts["trials_per_s"]
    successes = ", ".join(f"{name} {count}" for name, count in facts["successes"].items())
    console.print(
        f"equal labels: {report.equal} of {len(report.rows)} ({report.share:.1%}); successes: {successes} "
        f"(bias {100 * report.bias:+.1f} points)"
    )
    console.print(
        f"in collision at the start in MuJoCo only: {report.infeasible}; without feasible poses: {report.left_out}; "
        f"labels changed by early stops: {report.early_stop_changed}"
    )
    console.print(
        f"trials per second on {report.threads} threads: core {rate['core']:.2f} "
        f"({rate['core_without_early_stops']:.2f} without early stops), MuJoCo {rate['mujoco']:.2f}"
    )


def main(arguments: list[str] | None = None, check: Check = RANDOM) -> int:
    """Run a comparison; returns exit status 0 if it meets its goals for equal labels and bias, else 1."""
    args = _parser(check).parse_args(arguments)
    numerics = replace(Numerics(), timestep=args.timestep)
    how = {"source": check.source, "numerics": numerics, "repeat": args.repeat}
    report = options.compare(args, "trials", args.trials, compare, args.objects, args.trials, **how)
    options.print_report(args, report, _print)
    return 0 if report.rows and report.share >= check.goal and abs(report.bias) <= check.bias else 1


def compare_planner(arguments: list[str] | None = None) -> int:
    """Run the comparison on the planner's best grasps; see `main`."""
    return main(arguments, PLANNER)
