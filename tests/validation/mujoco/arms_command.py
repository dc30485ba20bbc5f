"""``python tests/validate.py arms``: paths of arms in the environments and in MuJoCo."""

import argparse
import json
from collections.abc import Sequence

from rich.console import Console

from validation.mujoco.arms import ANGLE, DISTANCE, ArmRow, follow_paths
from validation.options import make_parser, progress_bar

#: The included arms that carry the hand of the check.
_ARMS = ("fr3", "ur5e", "xarm7")


def main(arguments: Sequence[str] | None = None) -> int:
    """Follow paths; returns 1 if a flange is elsewhere."""
    parser = make_parser("arms", __doc__)
    parser.add_argument("--arm", action="append", help="an arm by its name; repeatable; by default " + ", ".join(_ARMS))
    parser.add_argument("--paths", type=int, default=34, help="paths per arm (34)")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a path (4)")
    args = parser.parse_args(arguments)
    names = args.arm or _ARMS
    with progress_bar(args) as bar:
        task = bar.add_task("paths", total=len(names) * args.paths)
        rows = []
        for index, name in enumerate(names):
            before = index * args.paths
            advance = lambda done, before=before: bar.update(task, completed=before + done)  # noqa: E731
            rows.append(follow_paths(name, args.paths, args.seconds, args.seed, advance))
    if args.json:
        print(json.dumps([row.to_json() for row in rows]))
    else:
        _show(args, rows)
    return 0 if all(row.agrees for row in rows) else 1


def _show(args: argparse.Namespace, rows: Sequence[ArmRow]) -> None:
    console = Console()
    for row in rows:
        console.print(
            f"{row.arm}: {row.paths} paths of {args.seconds:g} s, {row.travel:.2f} m each; flange within "
            f"{1e3 * row.distance:.3f} mm and {row.angle:.3f} degrees of MuJoCo's"
        )
    console.print(f"both agree: within {1e3 * DISTANCE:g} mm and {ANGLE:g} degrees")
