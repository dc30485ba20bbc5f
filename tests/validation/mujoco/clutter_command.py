"""``python tests/validate.py clutter``: rounds of clearing, whose attempts MuJoCo tries again in the same scenes."""

from __future__ import annotations

import argparse
import json
from typing import Any

from rich.progress import Progress

from graspbox import policies
from graspbox.evaluation.rounds import clear_rounds
from validation.mujoco.heaps import HeapJudge
from validation.options import progress_bar
from validation.versions import MUJOCO_VERSION, judged_by


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python tests/validate.py clutter", description=__doc__)
    parser.add_argument("policies", nargs="+", metavar="POLICY", help="policies of Clear-v0")
    parser.add_argument("--hand", default=None, help="name of the hand; by default that of the policy")
    parser.add_argument("--layout", nargs="+", default=["packed", "pile"], choices=["packed", "pile", "bin"])
    parser.add_argument("--objects", default="procedural:unseen:0-19", metavar="SET", help="object set (%(default)s)")
    parser.add_argument("--objects-per-scene", type=int, default=5, help="objects of a scene (%(default)s)")
    parser.add_argument("--rounds", type=int, default=40, help="rounds of each policy and layout (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first round (%(default)s)")
    parser.add_argument("--patch", type=float, default=0.0, help="mean radius of MuJoCo's contacts, mm (0: points)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser


def _judged(args: argparse.Namespace, name: str, layout: str, bar: Progress) -> dict[str, Any]:
    """Clear the rounds of a policy in a layout; the core's results and MuJoCo's."""
    policy = policies.load(name)
    task = bar.add_task(f"{name}, {layout}", total=args.rounds)
    with HeapJudge(args.hand or policy.settings.get("hand", "reflex"), patch=1e-3 * args.patch) as judge:
        rounds = clear_rounds(
            policy,
            objects=args.objects,
            layout=layout,  # type: ignore[arg-type]
            objects_per_scene=args.objects_per_scene,
            rounds=args.rounds,
            seed=args.seed,
            hand=args.hand,
            witness=judge,
            progress=lambda done: bar.update(task, completed=done),
        )
        theirs = judge.to_json()
    return {"policy": name, **rounds.to_json(), "mujoco": theirs, "mujoco_version": MUJOCO_VERSION}


def main(arguments: list[str] | None = None) -> int:
    """Run the comparison; returns exit status 0, or 1 if there was no attempt."""
    parser = _parser()
    args = parser.parse_args(arguments)
    for name in ("rounds", "objects_per_scene"):
        if getattr(args, name) < 1:
            parser.error(f"--{name.replace('_', '-')} is {getattr(args, name)}; give 1 or more")
    with progress_bar(args) as bar:
        results = [_judged(args, name, layout, bar) for name in args.policies for layout in args.layout]
    if args.json:
        print(json.dumps(results))
    else:
        for row in results:
            theirs = row["mujoco"]
            rates = f"{100 * row['success_rate']:.1f} % of {row['attempts']} attempts, MuJoCo: "
            rates += f"{100 * theirs['success_rate']:.1f} %, equal {theirs['equal']}, only the core "
            rates += f"{theirs['only_core']}, only MuJoCo {theirs['only_mujoco']}"
            print(f"{row['policy']}, {row['layout']}: {rates}")
        print(judged_by())
    return 0 if any(row["attempts"] for row in results) else 1
