"""Measure paths of arms in scenes of ten things: how many are found, how fast, and whether they touch anything.

    PYTHONPATH=tests python scripts/measure_paths.py --scenes 200

Per scene, ten procedural things stand on the table, 22 cm apart, and one of them is to be grasped by one of its 30 best
feasible grasps, lifted and placed in front of the others. Processor time is that of all threads for the whole path,
with timing, once meshes are prepared. The judge of `validation.arm_paths` looks at every path that was found, every
0.005 rad. Limits are those of the arm, with what is assumed where it states none.
"""

import argparse
import time
import warnings
from collections import Counter

import numpy as np

import graspbox
from graspbox import arms
from graspbox._common.programs import run_program
from graspbox.arms.timing import limits_of
from graspbox.errors import PathError
from measure_reach import BEHIND, Things, scene_of
from validation.arm_paths import Judge, limit_ratios


def task_of(scene: Things, seed: int, hand: str) -> tuple[int, graspbox.Plan | None, np.ndarray]:
    """Choose a thing of a scene, its grasps, and where it is placed."""
    random = np.random.default_rng(seed)
    chosen = int(random.integers(len(scene)))
    mesh, pose = scene[chosen]
    others = [placed for index, placed in enumerate(scene) if index != chosen]
    place = pose.copy()
    place[:2, 3] = random.uniform((-0.22, -0.25), (-0.16, 0.25))
    meshes, poses = zip(*others, strict=True)
    none = np.zeros((0, 4, 4)), np.zeros((0, 3))
    around = graspbox.Arrangement("packed", tuple(range(len(others))), meshes, np.stack(poses), *none)
    planned = graspbox.plan(mesh, hand=hand, world_from_object=pose, seed=seed, neighbours=around)
    return chosen, planned[planned.feasible][:30] if planned.feasible.any() else None, place


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--arm", default="fr3")
    parser.add_argument("--hand", default="panda_gripper")
    parser.add_argument("--no-place", action="store_true", help="end with the lift")
    parser.add_argument("--no-judge", action="store_true", help="only find paths")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    base = np.eye(4)
    base[0, 3] = BEHIND
    arm, hand = arms.load_arm(arguments.arm), graspbox.load_hand(arguments.hand)
    limits = limits_of(arm)
    cpus, durations, ratios, why = [], [], [], Counter()
    asked = reached = judged = collided = 0
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        scene = scene_of(seed)
        chosen, planned, place = task_of(scene, seed, arguments.hand)
        if planned is None:
            why["no feasible grasp"] += 1
            continue
        asked += 1
        others = [placed for index, placed in enumerate(scene) if index != chosen]
        mesh, pose = scene[chosen]
        reach = planned.reachable(arm, base, hand=hand, mesh=mesh, objects=others)
        reached += bool(reach.reached.any())
        options = {"objects": others, "mesh": mesh, "hand": hand, "config": graspbox.PathConfig(seed=seed)}
        if not arguments.no_place:
            options["place"] = place
        path = None
        for _ in range(2):
            cpu = time.process_time()
            try:
                path = planned.path(arm, base, **options)
            except PathError as error:
                failure = str(error)
            cpu = time.process_time() - cpu
        cpus.append(cpu)
        if path is None:
            why[failure] += 1
            print(f"scene {seed}: {failure} ({1e3 * cpu:.0f} ms)", flush=True)
            continue
        durations.append(path.duration)
        if arguments.no_judge:
            continue
        ratios.append(limit_ratios(path, limits.speed, limits.acceleration, limits.jerk))
        verdict = Judge(arm, hand, base, others, (mesh, pose), place)(path)
        judged += verdict.postures
        collided += bool(verdict.touches)
        for touch in verdict.touches[:3]:
            print(f"scene {seed}: {touch}", flush=True)
    milliseconds = 1e3 * np.array(cpus)
    found = len(durations)
    print(f"{arm.name} + {hand.name}: {found} paths of {asked} scenes with feasible grasps; {reached} with one reached")
    print(f"processor time: median {np.median(milliseconds):.1f} ms, worst {milliseconds.max():.0f} ms")
    print(f"duration: median {np.median(durations):.2f} s, longest {np.max(durations):.2f} s")
    if ratios:
        worst = np.max(ratios, axis=0)
        print(f"collisions: {collided} paths of {found}, in {judged} postures")
        print(f"greatest share of the limits: speed {worst[0]:.4f}, acceleration {worst[1]:.4f}, jerk {worst[2]:.4f}")
    for text, count in why.most_common():
        print(f"  {count}: {text}")


if __name__ == "__main__":
    run_program(main)
