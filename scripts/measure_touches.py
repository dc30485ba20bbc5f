r"""Measure the success of grasps whose open hand touches neighbours on its approach.

    python scripts/measure_touches.py --hand panda_gripper --layout packed --scenes 50 --seed 1000

Plans for every object of scenes of five, with every touch of a free neighbour allowed, and tries the two best free
grasps, the two best that touch and four other ones that touch, with the trial that pushes neighbours aside. Prints the
success of grasps whose score without penalty is above ``--least-score`` by ``press`` (see `graspbox.Plan`), and of
pushes that are mostly sideways by ``touch``.
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox import object_sets
from graspbox._common.programs import run_program
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.simulation.layouts import draw_objects, objects_that_fit

#: Bounds of the bins of depths, metres.
DEPTHS = (0.0, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02, 0.5)
#: Greatest share of a touch that presses, for a push that is mostly sideways.
SIDEWAYS = 0.3

Rows = NDArray[np.float64]


def chosen(plan: graspbox.Plan, random: np.random.Generator) -> graspbox.Plan:
    """Choose two free grasps and six that touch, of which four at random among the best 60."""
    touching = np.flatnonzero(plan.feasible & (plan.touch > 0))[:60]
    free = np.flatnonzero(plan.feasible & (plan.touch == 0))[:2]
    others = random.permutation(touching[2:])[:4]
    return plan[np.concatenate([free, touching[:2], others])]


def trials(args: argparse.Namespace) -> Iterator[Rows]:
    """Yield rows (n, 4) of each scene: score, touch, press, success."""
    hand = load_hand(args.hand)
    objects = objects_that_fit(object_sets.load(args.objects), args.layout, hand)
    for seed in range(args.seed, args.seed + args.scenes):
        meshes = [spec.load() for spec in draw_objects(tuple(objects), 5, args.layout, seed)]
        heap = graspbox.arrange(meshes, args.layout, most=5, seed=seed, hand=hand)
        random = np.random.default_rng(seed)
        plans = []
        for index, (mesh, rest) in enumerate(zip(heap.meshes, heap.world_from_objects, strict=True)):
            others = heap.without(index)
            planned = graspbox.plan(
                mesh, hand=hand, world_from_object=rest, neighbours=others, max_press=0.05, press_penalty=0.0
            )
            plans.append(chosen(planned, random))
        if not sum(map(len, plans)):
            continue
        scene = graspbox.Scene.of(heap, hand=hand)
        world = [rest @ plan.poses for rest, plan in zip(heap.world_from_objects, plans, strict=True)]
        poses = np.linalg.inv(scene.world_from_object) @ np.concatenate(world)
        outcomes = scene.simulate(poses, preshape=np.concatenate([plan.preshape for plan in plans]))
        columns = [np.concatenate([getattr(plan, name) for plan in plans]) for name in ("score", "touch", "press")]
        yield np.stack([*columns, outcomes.success.astype(np.float64)], axis=1)


def table(title: str, values: Rows, success: Rows) -> None:
    """Print the success of grasps by depth."""
    print(title)
    for low, high in pairwise(DEPTHS):
        within = (values >= low) & (values < high)
        if within.any():
            print(f"  {1e3 * low:g} to {1e3 * high:g} mm: {within.sum()} grasps, {success[within].mean():.0%} succeed")


def report(rows: Rows) -> None:
    """Print all tables."""
    _, touch, press, success = rows.T
    free = touch == 0
    rate = f": {success[free].mean():.0%} succeed" if free.any() else ""
    print(f"{free.sum()} grasps that touch nothing{rate}")
    table("press, of all that touch", press[~free], success[~free])
    sideways = ~free & (press <= SIDEWAYS * touch)
    table("touch, of those that push sideways", touch[sideways], success[sideways])


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hand", default="panda_gripper")
    parser.add_argument("--objects", nargs="+", default=["procedural:seen:0-19"])
    parser.add_argument("--layout", choices=("packed", "pile", "bin"), default="packed")
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--least-score", type=float, default=6.0, help="others often fail without a touch, too")
    args = parser.parse_args()
    rows = np.concatenate([np.zeros((0, 4)), *trials(args)])
    rows = rows[rows[:, 0] > args.least_score]
    if not len(rows):
        raise ConfigError(
            f"no grasp has a score above {args.least_score:g}; pass more --scenes or another --least-score"
        )
    report(rows)


if __name__ == "__main__":
    run_program(main)
