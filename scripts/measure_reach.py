"""Measure what arms reach of the grasps in scenes of ten things, and how long the answer takes.

    python scripts/measure_reach.py --scenes 5

Per scene, ten procedural things stand on the table, 22 cm apart; 20 grasps of each are planned for the Franka Hand, and
tested against the shapes of all ten and, in a second run, against points on their surfaces. Times are wall times of the
call and processor times (all threads), in milliseconds; processor time changes little if other programs compete for
the cores.
"""

import argparse
import time
from collections import Counter

import numpy as np

import graspbox
from graspbox import arms, object_sets
from graspbox._common.programs import run_program

#: Base of the arm, before the middle of the scene, metres.
BEHIND = -0.5


#: Places of the things: a grid of five by two, metres.
PLACES = [(x, y) for x in (0.0, 0.22) for y in (-0.44, -0.22, 0.0, 0.22, 0.44)]
Things = list[tuple[graspbox.Mesh, np.ndarray]]


def scene_of(seed: int) -> Things:
    """Put ten random things on the table, each in its most probable resting pose, turned at random."""
    random = np.random.default_rng(seed)
    names = object_sets.load("procedural")
    things = []
    for index, (x, y) in zip(random.permutation(len(names)), PLACES, strict=False):
        mesh, angle = names[int(index)].load(), random.uniform(0, 2 * np.pi)
        place = np.eye(4)
        place[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        place[:2, 3] = x, y
        things.append((mesh, place @ mesh.resting_poses()[0][0]))
    return things


def grasps_of(things: Things, each: int) -> tuple[np.ndarray, np.ndarray]:
    """Plan grasps of all things: poses (n, 4, 4), world frame, and preshapes (n,)."""
    plans = [graspbox.plan(mesh, hand="panda_gripper", world_from_object=place)[:each] for mesh, place in things]
    poses = [plan.world_from_object @ plan.poses for plan in plans]
    return np.concatenate(poses), np.concatenate([plan.preshape for plan in plans])


def points_of(things: Things, count: int = 2000) -> np.ndarray:
    """Return points on the surfaces of all things, world frame."""
    return np.concatenate([mesh.sample(count, 0)[0] @ place[:3, :3].T + place[:3, 3] for mesh, place in things])


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=5)
    parser.add_argument("--each", type=int, default=20, help="grasps per thing")
    parser.add_argument("--arms", nargs="+", default=["fr3", "ur5e", "xarm7"])
    arguments = parser.parse_args()
    base = np.eye(4)
    base[0, 3] = BEHIND
    scenes = [scene_of(seed) for seed in range(arguments.scenes)]
    grasps = [grasps_of(scene, arguments.each) for scene in scenes]
    print("arm     obstacles  grasps  reached  wall ms  processor ms")
    for name in arguments.arms:
        for kind in ("shapes", "points"):
            why: Counter[str] = Counter()
            walls, cpus, count, reached = [], [], 0, 0
            for scene, (poses, preshapes) in zip(scenes, grasps, strict=True):
                around = {"objects": scene} if kind == "shapes" else {"points": points_of(scene)}
                for repeat in range(3):
                    wall, cpu = time.perf_counter(), time.process_time()
                    reach = arms.reachable(name, "panda_gripper", poses, preshapes, base, **around)
                    if repeat:
                        walls.append(time.perf_counter() - wall)
                        cpus.append(time.process_time() - cpu)
                why.update(reach.counts())
                count, reached = count + len(reach), reached + int(reach.reached.sum())
            wall, cpu = 1e3 * np.median(walls), 1e3 * np.median(cpus)
            per = count / len(scenes)
            print(f"{name:6}  {kind:9}  {per:6.0f}  {reached / count:6.1%}  {wall:7.1f}  {cpu:12.1f}", flush=True)
        print("        ", ", ".join(f"{text} ({number})" for text, number in why.most_common(6)))


if __name__ == "__main__":
    run_program(main)
