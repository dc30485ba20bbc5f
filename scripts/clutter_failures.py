"""Find out why a policy fails in clutter: try its next best grasps after each failure.

    python scripts/clutter_failures.py policies/panda_clutter --layout packed --rounds 40 --seed 500

Clears scenes of five objects as ``graspbox benchmark clutter`` does. After every failed attempt the scene is restored,
and the next best of the grasps that the policy scored are tried in it. Where most of them succeed, the scorer limits
the policy; where none does, the proposals or the completion do. The last table compares the stated probability of
success with the outcomes.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np

from graspbox import object_sets
from graspbox.envs.coding import encode_action
from graspbox.errors import ConfigError, GraspboxError
from graspbox.layouts import objects_that_fit
from graspbox.perception import FoundGrasp
from graspbox.policies import DepthGrasp, load
from graspbox.policies.base import Task
from graspbox.programs import run_program

#: Bounds of the probabilities that are put together.
BOUNDS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)


def alternatives(env: Any, before: bytes, found: FoundGrasp, hand: Any, count: int) -> list[bool]:
    """Try the next best grasps, each in the restored scene, which is left as it is after the last one."""
    outcomes = []
    for grasp in np.argsort(-found.scores, kind="stable")[1 : count + 1]:
        env.set_state(before)
        pose = found.world_from_crop @ found.poses[grasp]
        info = env.step(encode_action(pose, float(found.preshapes[grasp]), hand=hand))[-1]
        outcomes.append(bool(info["is_success"]))
    return outcomes


def attempts(policy: DepthGrasp, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Clear scenes, attempt by attempt."""
    hand = args.hand or policy.settings["hand"]
    objects = objects_that_fit(object_sets.load(args.objects), args.layout, hand)
    settings = {**policy.settings, "hand": hand, "obs": policy.obs}
    with gymnasium.make("graspbox/Clear-v0", objects=objects, layout=args.layout, **settings) as made:
        policy.bind(Task.of(made))
        env: Any = made.unwrapped
        for number in range(args.seed, args.seed + args.rounds):
            observation, info = made.reset(seed=number)
            policy.reset(number, info=info)
            over = False
            while not over:
                action = policy.act({name: values[None] for name, values in observation.items()})[0]
                found, before = policy.found[0], env.get_state()
                observation, _, ended, cut, info = made.step(action)
                over = ended or cut
                row = {"round": number, "object": info["object"], "failure": info["failure"]}
                row |= {"success": bool(info["is_success"]), "stated": policy.confidence(0)}
                if not row["success"] and found is not None:
                    after = env.get_state()
                    row["others"] = alternatives(env, before, found, hand, args.alternatives)
                    env.set_state(after)
                yield row


def report(rows: list[dict[str, Any]]) -> None:
    """Print failures, and the outcomes by stated probability."""
    print(f"{sum(row['success'] for row in rows)} of {len(rows)} attempts succeed")
    for row in rows:
        if not row["success"]:
            others = row.get("others", [])
            print(
                f"{row['object']}: {row['failure']}, stated {row['stated']:.2f}; of the {len(others)} next best grasps "
                f"{sum(others)} succeed"
            )
    stated = np.array([row["stated"] for row in rows])
    success = np.array([row["success"] for row in rows])
    for low, high in pairwise(BOUNDS):
        within = (stated >= low) & (stated < high if high < 1.0 else stated <= high)
        if within.any():
            print(f"stated {low:.2f} to {high:.2f}: {within.sum()} attempts, {success[within].mean():.0%} succeed")


def main() -> int:
    """Run as a script; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="a policy of one depth image that clears scenes, by folder or name")
    parser.add_argument("--hand", help="by default that of the policy")
    parser.add_argument("--objects", default="procedural:unseen:0-19")
    parser.add_argument("--layout", choices=("packed", "pile", "bin"), default="packed")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--alternatives", type=int, default=24, help="grasps that are tried after a failure")
    parser.add_argument("--json", action="store_true", help="print all attempts as JSON")
    args = parser.parse_args()
    try:
        policy = load(args.policy)
        if not isinstance(policy, DepthGrasp):
            raise ConfigError(f"{args.policy!r} is no published policy of one depth image; name one that is")
        rows = list(attempts(policy, args))
    except (GraspboxError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps(rows, indent=1))
    else:
        report(rows)
    return 0


if __name__ == "__main__":
    run_program(main)
