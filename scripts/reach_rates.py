"""Measure in which scenes an arm reaches some grasp of the planner, against a hand that flies freely.

    python scripts/reach_rates.py --scenes 200 --layout single
    python scripts/reach_rates.py --scenes 60 --layout packed --json

Single things lie within 0.2 m of the workspace's middle along x and y, in a resting pose drawn by its probability;
packed scenes have up to ten (`graspbox.arrange`). The base stands on the table before the middle, as a person would put
it. Grasps are those that the planner calls feasible among the neighbours, the best 60 of each thing; the arm's links
touch neither table nor things. Equal arguments give equal numbers.
"""

import argparse
import json
import time
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox import arms, object_sets
from graspbox._common.programs import run_program
from graspbox.simulation.layouts import Arrangement, draw_objects, draws, objects_that_fit

#: Hands on arms, with the distance of the base from the middle of the workspace, metres.
PAIRS = {
    "fr3,panda_gripper": 0.5,
    "ur5e,robotiq_2f_85": 0.5,
    "xarm7,reflex": 0.45,
    "xarm7,leap": 0.45,
}
#: Where single things lie, metres; most things of a packed scene, and how far apart they stand; most grasps of each.
AROUND, MOST, SPREAD, GRASPS = 0.2, 10, 2.0, 60


class Scene(NamedTuple):
    """Things at rest, and the feasible grasps of each."""

    things: Arrangement
    plans: list[graspbox.Plan]


def scene_of(hand: str, objects: object_sets.ObjectSet, layout: str, seed: int) -> Scene:
    """Make a scene, and plan all its grasps."""
    random = np.random.default_rng(seed)
    if layout == "single":
        mesh = objects[int(random.integers(len(objects)))].load()
        poses, chances = mesh.resting_poses()
        angle, place = random.uniform(0, 2 * np.pi), np.eye(4)
        place[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        place[:2, 3] = random.uniform(-AROUND, AROUND, 2)
        things = Arrangement.of_one(mesh, place @ poses[random.choice(len(poses), p=chances / chances.sum())])
    else:
        specs = draw_objects(list(objects), draws("packed", MOST), "packed", seed)
        meshes = [spec.load() for spec in specs]
        things = graspbox.arrange(meshes, "packed", most=MOST, spread=SPREAD, seed=seed, hand=hand)
    plans = []
    for index, (mesh, pose) in enumerate(zip(things.meshes, things.world_from_objects, strict=True)):
        around = things.without(index)
        plan = graspbox.plan(mesh, hand=hand, seed=seed, world_from_object=pose, neighbours=around)
        plans.append(plan.best(GRASPS))
    return Scene(things, plans)


def reached_in(scene: Scene, arm: str, hand: str, base: NDArray[np.float64], why: Counter[str]) -> list[list[bool]]:
    """Return which grasps of each thing are reached."""
    poses = np.concatenate([plan.world_from_object @ plan.poses for plan in scene.plans])
    preshapes = np.concatenate([plan.preshape for plan in scene.plans])
    reach = arms.reachable(arm, hand, poses, preshapes, base, neighbours=scene.things)
    why.update(arms.Reason(int(code)).name for code in reach.reason)
    ends = np.cumsum([len(plan) for plan in scene.plans])[:-1]
    return [rows.tolist() for rows in np.split(reach.reached, ends)]


def measured(pair: str, layout: str, scenes: int, first: int) -> dict[str, Any]:
    """Measure one arm with a hand."""
    arm, hand = pair.split(",")
    base = np.eye(4)
    base[0, 3] = -PAIRS[pair]
    objects = objects_that_fit(object_sets.load("procedural:unseen"), "packed", hand)
    counts, why, start = Counter[str](), Counter[str](), time.process_time()
    for seed in range(first, first + scenes):
        scene = scene_of(hand, objects, layout, seed)
        reached = reached_in(scene, arm, hand, base, why)
        free = [len(rows) > 0 for rows in reached]
        counts["things"] += len(reached)
        counts["things free"] += sum(free)
        counts["things reached"] += sum(any(rows) for rows in reached)
        counts["first reached"] += sum(rows[0] for rows in reached if rows)
        counts["scenes free"] += any(free)
        counts["scenes reached"] += any(any(rows) for rows in reached)
    grasps = sum(why.values())
    return {
        "arm": arm,
        "hand": hand,
        "base": PAIRS[pair],
        "layout": layout,
        "scenes": scenes,
        **counts,
        "grasps": grasps,
        "why": {name: count / grasps for name, count in why.most_common()},
        "processor seconds": round(time.process_time() - start, 1),
    }


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--layout", choices=["single", "packed"], default="single")
    parser.add_argument("--pairs", nargs="+", default=list(PAIRS), choices=list(PAIRS), metavar="ARM,HAND")
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--json", action="store_true", help="print a line of JSON per arm")
    arguments = parser.parse_args()
    if not arguments.json:
        print("arm    hand            scenes free / reached  things free / reached  first  grasps reached")
    for pair in arguments.pairs:
        row = measured(pair, arguments.layout, arguments.scenes, arguments.seed)
        if arguments.json:
            print(json.dumps(row), flush=True)
            continue
        shares = [f"{row['scenes ' + kind] / row['scenes']:.1%}" for kind in ("free", "reached")]
        things = [f"{row['things ' + kind] / row['things']:.1%}" for kind in ("free", "reached")]
        first, all_ = row["first reached"] / max(row["things free"], 1), row["why"].get("REACHED", 0.0)
        print(f"{row['arm']:6} {row['hand']:15} {' / '.join(shares)}  {' / '.join(things)}  {first:.1%}  {all_:.1%}")
        print("      ", ", ".join(f"{name.lower()} {share:.1%}" for name, share in row["why"].items()), flush=True)


if __name__ == "__main__":
    run_program(main)
