"""``python -m graspbox.validation mujoco``: print how often MuJoCo and the core agree."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from graspbox.errors import GraspboxError
from graspbox.validation.mujoco import DEFAULT_OBJECTS, Numerics, Report, compare

#: The share of equal labels below which the command fails.
GOAL = 0.90


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m graspbox.validation mujoco", description=__doc__)
    parser.add_argument("--trials", type=int, default=200, help="feasible grasps to judge (200)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the poses (0)")
    parser.add_argument("--objects", nargs="+", default=list(DEFAULT_OBJECTS), metavar="SET", help="object sets")
    parser.add_argument("--hand", default="reflex", help="a hand by its name (reflex)")
    parser.add_argument("--threads", type=int, default=None, help="threads for both engines; all by default")
    parser.add_argument("--timestep", type=float, default=Numerics().timestep, help="MuJoCo's time step, s (0.001)")
    parser.add_argument(
        "--no-explain", action="store_true", help="do not repeat trials with different labels at half the time step"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _print(console: Console, report: Report) -> None:
    facts = report.to_json()
    table = Table(
        "object", "core", "MuJoCo", "core lift", "MuJoCo lift", "speed, mm/s", "links", "why", title="differences"
    )
    for row in report.rows:
        if not row.equal:
            m = row.mujoco
            links = f"{m.touching[0]} -> {m.touching[1]}"
            speed = f"{m.speed * 1e3:.2f}"
            table.add_row(
                row.object,
                row.failure or "success",
                m.failure or "success",
                f"{row.lift:.3f}",
                f"{m.lift:.3f}",
                speed,
                links,
                row.why or "",
            )
    console.print(table)
    for title, key in (("core / MuJoCo", "by_kind"), ("why", "by_why"), ("object", "by_object")):
        counts = Table(title, "differences")
        for name, count in facts[key].items():
            counts.add_row(name, str(count))
        console.print(counts)
    rate = facts["trials_per_s"]
    console.print(
        f"equal labels: {report.equal} of {len(report.rows)} ({report.share:.1%}); "
        f"successes: core {facts['core_success']}, MuJoCo {facts['mujoco_success']}"
    )
    console.print(
        f"in collision at the start for MuJoCo alone: {report.infeasible}; without feasible poses: {report.left_out}; "
        f"labels changed by early stops: {report.early_stop_changed}"
    )
    console.print(
        f"trials per second on {report.threads} threads: core {rate['core']:.2f} "
        f"({rate['core_without_early_stops']:.2f} without early stops), MuJoCo {rate['mujoco']:.2f}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; returns exit status 0 if the share of equal labels reaches the goal, else 1."""
    args = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    try:
        with Progress(console=errors, disable=args.json and not sys.stderr.isatty()) as bar:
            task = bar.add_task("trials", total=args.trials)
            report = compare(
                args.objects,
                args.trials,
                args.seed,
                hand=args.hand,
                threads=args.threads,
                numerics=replace(Numerics(), timestep=args.timestep),
                explain=not args.no_explain,
                progress=lambda done: bar.update(task, completed=done),
            )
    except GraspboxError as error:
        errors.print(f"graspbox: {error}", markup=False, highlight=False)
        return 2
    if args.json:
        print(json.dumps(report.to_json()))
    else:
        _print(Console(), report)
    return 0 if report.rows and report.share >= GOAL else 1
