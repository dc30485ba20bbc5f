"""``python tests/validate.py robust``: success of perturbed copies of grasps, in the core and in MuJoCo."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from validation import options
from validation.mujoco import PLANNER_OBJECTS, Numerics, Perturbation, RobustReport, compare_robust
from validation.versions import judged_by


def _parser() -> argparse.ArgumentParser:
    parser = options.make_parser("robust", __doc__)
    parser.add_argument("--grasps", type=int, default=200, help="grasps, distributed evenly over the objects (200)")
    parser.add_argument("--replays", type=int, default=16, help="perturbed copies of each grasp (16)")
    parser.add_argument("--shift", type=float, default=5.0, help="greatest translation of a copy, mm (5)")
    parser.add_argument("--turn", type=float, default=5.0, help="greatest rotation of a copy, degrees (5)")
    parser.add_argument("--objects", nargs="+", default=list(PLANNER_OBJECTS), metavar="SET", help="object sets")
    parser.add_argument("--hand", default="reflex", help="name of the hand (reflex)")
    step = Numerics().timestep
    parser.add_argument("--timestep", type=float, default=step, help=f"MuJoCo's time step, s ({step})")
    parser.add_argument("--resume", type=Path, default=None, help="file for results of finished objects (none)")
    return parser


def _print(console: Console, report: RobustReport) -> None:
    console.print(judged_by())
    facts = report.facts()
    console.print(f"{facts['grasps']} grasps, {facts.get('replays', 0)} replays; left out: {facts['left_out']}")
    if not report.rows:
        return
    means = ", ".join(f"{name} {share:.1%}" for name, share in facts["mean_share"].items())
    console.print(f"replays that succeed: {means}")
    table = Table("engines", "Spearman", "bias, points", "mean difference, points", "equal labels", "kappa")
    for pair in ("core / mujoco", "core / core_half"):
        row = facts[pair]
        bias = f"{100 * row['bias']:+.1f} +- {100 * row['bias_standard_error']:.1f}"
        order = "-" if row["spearman"] is None else f"{row['spearman']:.3f}"
        numbers = (order, bias, f"{100 * row['mean_difference']:.1f}", f"{row['equal']:.1%}")
        table.add_row(pair, *numbers, f"{row['kappa']:.2f}")
    console.print(table)


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; returns exit status 0, or 1 if there was no grasp to compare."""
    args = _parser().parse_args(arguments)
    how = Perturbation(args.replays, args.shift * 1e-3, float(np.deg2rad(args.turn)))
    more = {"how": how, "numerics": replace(Numerics(), timestep=args.timestep), "resume": args.resume}
    report = options.compare(args, "grasps", args.grasps, compare_robust, args.objects, args.grasps, **more)
    options.print_report(args, report, _print)
    return 0 if report.rows else 1
