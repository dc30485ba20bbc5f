"""Measure paths of arms in scenes of ten things: how many are found, how fast, and whether they touch anything.

    PYTHONPATH=tests python scripts/measure_paths.py --scenes 200

Per scene, ten procedural things stand on the table, 22 cm apart, and one of them is to be grasped by one of its 30 best
feasible grasps, lifted and placed where there is room. Processor time is that of all threads for the whole path,
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

#: Least distance between the bounds of a thing at its place and those of the others, metres.
ROOM = 0.02


def apart(mesh: graspbox.Mesh, place: np.ndarray, other: graspbox.Mesh, there: np.ndarray) -> float:
    """Return the distance of two things along the farther axis of the table, by their bounds."""
    one, two = (m.vertices @ pose[:2, :3].T + pose[:2, 3] for m, pose in ((mesh, place), (other, there)))
    return float(np.maximum(one.min(axis=0) - two.max(axis=0), two.min(axis=0) - one.max(axis=0)).max())


def task_of(scene: Things, seed: int, hand: graspbox.Hand) -> tuple[int, graspbox.Plan | None, np.ndarray]:
    """Choose a thing of a scene, its grasps, and where it is placed."""
    random = np.random.default_rng(seed)
    chosen = int(random.integers(len(scene)))
    mesh, pose = scene[chosen]
    others = [placed for index, placed in enumerate(scene) if index != chosen]
    place = pose.copy()
    for _ in range(1000):
        place[:2, 3] = random.uniform((-0.25, -0.45), (0.11, 0.45))
        if all(apart(mesh, place, *other) > ROOM for other in others):
            break
    meshes, poses = zip(*others, strict=True)
    none = np.zeros((0, 4, 4)), np.zeros((0, 3))
    around = graspbox.Arrangement("packed", tuple(range(len(others))), meshes, np.stack(poses), *none)
    planned = graspbox.plan(mesh, hand=hand, world_from_object=pose, seed=seed, neighbours=around)
    return chosen, planned[planned.feasible][:30] if planned.feasible.any() else None, place


class Tally:
    """What was found in all scenes."""

    def __init__(self) -> None:
        self.cpus: list[float] = []
        self.durations: list[float] = []
        self.ratios: list[np.ndarray] = []
        self.why: Counter[str] = Counter()
        self.asked = self.reached = self.postures = self.collided = 0

    def show(self) -> None:
        """Print it."""
        milliseconds, found = 1e3 * np.array(self.cpus), len(self.durations)
        print(f"{found} paths of {self.asked} scenes with feasible grasps; {self.reached} with one reached")
        print(f"processor time: median {np.median(milliseconds):.1f} ms, worst {milliseconds.max():.0f} ms")
        print(f"duration: median {np.median(self.durations):.2f} s, longest {np.max(self.durations):.2f} s")
        if self.ratios:
            worst = np.max(self.ratios, axis=0)
            print(f"collisions: {self.collided} paths of {len(self.ratios)}, in {self.postures} postures")
            names = ("speed", "acceleration", "jerk", "speed near the ends of ranges")
            shares = ", ".join(f"{name} {share:.4f}" for name, share in zip(names, worst, strict=True))
            print(f"greatest share of the limits: {shares}")
        for text, count in self.why.most_common():
            print(f"  {count}: {text}")


def measure(seed: int, arm: arms.Arm, hand: graspbox.Hand, placing: bool, judging: bool, tally: Tally) -> None:
    """Plan a path in a scene, and judge it."""
    base = np.eye(4)
    base[0, 3] = BEHIND
    scene = scene_of(seed)
    chosen, planned, place = task_of(scene, seed, hand)
    if planned is None:
        tally.why["no feasible grasp"] += 1
        return
    others = [placed for index, placed in enumerate(scene) if index != chosen]
    mesh, pose = scene[chosen]
    reach = planned.reachable(arm, base, hand=hand, mesh=mesh, objects=others)
    tally.asked += 1
    tally.reached += bool(reach.reached.any())
    options = {"objects": others, "mesh": mesh, "hand": hand, "config": graspbox.PathConfig(seed=seed)}
    path, failure = None, ""
    for _ in range(2):
        cpu = time.process_time()
        try:
            path = planned.path(arm, base, place=place if placing else None, **options)
        except PathError as error:
            failure = str(error)
        cpu = time.process_time() - cpu
    tally.cpus.append(cpu)
    if path is None:
        tally.why[failure] += 1
        print(f"scene {seed}: {failure} ({1e3 * cpu:.0f} ms)", flush=True)
        return
    tally.durations.append(path.duration)
    if not judging:
        return
    limits = limits_of(arm)
    tally.ratios.append(limit_ratios(path, limits))
    verdict = Judge(arm, hand, base, others, (mesh, pose), place)(path)
    tally.postures += verdict.postures
    tally.collided += bool(verdict.touches)
    facts = f"{path.duration:.2f} s, {1e3 * cpu:.1f} ms, limits {tally.ratios[-1].max():.4f}"
    print(f"scene {seed}: {facts}, {verdict.postures} postures, {len(verdict.touches)} touches", flush=True)
    for touch in verdict.touches[:3]:
        print(f"scene {seed}: {touch}", flush=True)


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
    arm, hand, tally = arms.load_arm(arguments.arm), graspbox.load_hand(arguments.hand), Tally()
    for seed in range(arguments.first, arguments.first + arguments.scenes):
        measure(seed, arm, hand, not arguments.no_place, not arguments.no_judge, tally)
    print(f"{arm.name} + {hand.name}")
    tally.show()


if __name__ == "__main__":
    run_program(main)
