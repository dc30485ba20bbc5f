r"""Find out why a policy fails in clutter: try its next best grasps after each failure.

    python scripts/clutter_failures.py policies/panda_clutter --layout packed --rounds 40 --seed 500
    python scripts/clutter_failures.py policies/panda_clutter --levers --alternatives 12 --objects-per-scene 2 \
        --objects procedural:spoon:0-19 procedural:clamp:0-19 --rounds 40 --seed 700

Clears scenes of five objects as ``graspbox benchmark clutter`` does. After every failed attempt the scene is restored,
and the next best of the grasps that the policy scored are tried in it. If most of them succeed, the scorer limits the
policy; if none does, the proposals or the completion do. The last table compares the stated probability of
success with the outcomes.

With ``--levers`` they are tried after every attempt, and the table is one of all grasps, by how far from the middle of
an object they hold it: a scorer should know that a long object tips.
"""

import argparse
import json
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._common.programs import run_program
from graspbox.envs.coding import encode_action
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand, reach_of
from graspbox.perception import FoundGrasp
from graspbox.policies import DepthGrasp, load
from graspbox.policies.base import Task
from graspbox.simulation.layouts import Arrangement, objects_that_fit

#: Bounds of the bins of probabilities.
BOUNDS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
#: Bounds of the bins of distances, metres.
LEVERS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1, 0.5)


def lever(pose: NDArray[np.float64], scene: Arrangement, reach: float) -> float:
    """Return how far, in plan view, fingertips of this reach are from the nearest centre of mass, metres."""
    tip = pose[:3, 3] + reach * pose[:3, 2]
    placed = zip(scene.meshes, scene.world_from_objects, strict=True)
    centers = [at[:3, :3] @ np.asarray(mesh.center_of_mass) + at[:3, 3] for mesh, at in placed]
    return min(float(np.linalg.norm((tip - center)[:2])) for center in centers)


def alternatives(
    env: Any, before: bytes, found: FoundGrasp, scene: Arrangement, hand: Hand, count: int
) -> list[dict[str, Any]]:
    """Try the next best grasps, each in the restored scene, which is left as it is after the last one."""
    tried, reach = [], reach_of(hand, found.preshape)
    for grasp in np.argsort(-found.scores, kind="stable")[1 : count + 1]:
        env.set_state(before)
        pose = found.world_from_crop @ found.poses[grasp]
        info = env.step(encode_action(pose, float(found.preshapes[grasp]), hand=hand))[-1]
        row = {"success": bool(info["is_success"]), "score": float(found.scores[grasp])}
        tried.append(row | {"lever": lever(pose, scene, reach)})
    return tried


def attempts(policy: DepthGrasp, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Clear scenes, attempt by attempt."""
    hand = load_hand(args.hand or policy.settings["hand"])
    objects = objects_that_fit(object_sets.load(args.objects, split=args.split), args.layout, hand)
    settings = {**policy.settings, "hand": hand, "obs": policy.obs, "objects_per_scene": args.objects_per_scene}
    with gymnasium.make("graspbox/Clear-v0", objects=objects, layout=args.layout, **settings) as made:
        policy.bind(Task.of(made))
        env: Any = made.unwrapped
        for number in range(args.seed, args.seed + args.rounds):
            observation, info = made.reset(seed=number)
            policy.reset(number, info=info)
            over = False
            while not over:
                action = policy.act({name: values[None] for name, values in observation.items()})[0]
                found, before, scene = policy.found[0], env.get_state(), env.arrangement()
                observation, _, ended, cut, info = made.step(action)
                over = ended or cut
                row = {"round": number, "object": info["object"], "failure": info["failure"]}
                row |= {"success": bool(info["is_success"]), "stated": policy.confidence(0)}
                if found is not None and (args.levers or not row["success"]):
                    after = env.get_state()
                    row["others"] = alternatives(env, before, found, scene, hand, args.alternatives)
                    row["score"] = found.score
                    row["lever"] = lever(found.world_from_hand, scene, reach_of(hand, found.preshape))
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
                f"{sum(other['success'] for other in others)} succeed"
            )
    stated = np.array([row["stated"] for row in rows])
    success = np.array([row["success"] for row in rows])
    for low, high in pairwise(BOUNDS):
        within = (stated >= low) & (stated < high if high < 1.0 else stated <= high)
        if within.any():
            print(f"stated {low:.2f} to {high:.2f}: {within.sum()} attempts, {success[within].mean():.0%} succeed")


def report_levers(rows: list[dict[str, Any]]) -> None:
    """Print success and scores of all grasps by their distance from the middle of an object."""
    chosen = [row for row in rows if "lever" in row]
    print(f"{sum(row['success'] for row in rows)} of {len(rows)} attempts succeed")
    for low, high in pairwise(LEVERS):
        grasps = [grasp for row in chosen for grasp in (row, *row["others"]) if low <= grasp["lever"] < high]
        if grasps:
            success, score = (np.mean([grasp[name] for grasp in grasps]) for name in ("success", "score"))
            print(
                f"{1e3 * low:.0f} to {1e3 * high:.0f} mm from the middle: {len(grasps)} grasps, {success:.0%} succeed, "
                f"mean score {score:.2f}"
            )


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="a policy of one depth image that clears scenes, by folder or name")
    parser.add_argument("--hand", help="by default that of the policy")
    parser.add_argument("--objects", nargs="+", default=["procedural:unseen:0-19"])
    parser.add_argument("--split", choices=("train", "validation", "test"), help="use only this split")
    parser.add_argument("--objects-per-scene", type=int, default=5)
    parser.add_argument("--layout", choices=("packed", "pile", "bin"), default="packed")
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--alternatives", type=int, default=24, help="grasps that are tried after a failure")
    parser.add_argument("--levers", action="store_true", help="try them after every attempt, for the table by distance")
    parser.add_argument("--json", action="store_true", help="print all attempts as JSON")
    args = parser.parse_args()
    policy = load(args.policy)
    if not isinstance(policy, DepthGrasp):
        raise ConfigError(f"{args.policy!r} is not a published policy of one depth image; name one that is")
    rows = list(attempts(policy, args))
    if args.json:
        print(json.dumps(rows, indent=1))
    elif args.levers:
        report_levers(rows)
    else:
        report(rows)


if __name__ == "__main__":
    run_program(main)
