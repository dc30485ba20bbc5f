"""Measure the processor time of trials and of environment steps with a single object, on one thread.

Run it in two checkouts in turn, each with its own build, to compare them::

    python scripts/measure_trials.py
    python scripts/measure_trials.py --hand panda_gripper --repeats 9
"""

import argparse
import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np

import graspbox
from graspbox._common.programs import run_program

#: An object with flat faces, and others with round ones, thin ones and holes.
OBJECTS = ("procedural:box:4", "procedural:can:2", "procedural:ball:2", "procedural:banana:1", "procedural:mug:3")
POSES, STEPS, ENVS = 20, 60, 8


def least(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of some runs, seconds; the first one, which fills caches, does not count."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def main() -> None:
    """Print milliseconds of a trial with each object, and of a step of an environment."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hand", default="reflex", help="hand")
    parser.add_argument("--repeats", type=int, default=5, help="runs, of which the fastest counts")
    args = parser.parse_args()
    total = 0.0
    for name in OBJECTS:
        mesh = graspbox.object_sets.load(name)[0].load()
        scene = graspbox.Scene(mesh, hand=args.hand)
        plan = graspbox.plan(mesh, hand=args.hand, world_from_object=scene.world_from_object).best(POSES)

        def simulate(scene: graspbox.Scene = scene, plan: graspbox.Plan = plan) -> object:
            return scene.simulate(plan, num_threads=1)

        each = 1e3 * least(simulate, args.repeats) / len(plan)
        total += each
        print(f"{name:22}{each:8.3f} ms a trial")
    print(f"{'mean':22}{total / len(OBJECTS):8.3f} ms a trial")
    settings = {"objects": "procedural:mug:0-9", "hand": args.hand, "num_threads": 1, "control_freq": 20}
    envs = gym.make_vec("graspbox/Grasp-v0", num_envs=ENVS, **settings)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, *(envs.action_space.shape or ()))).astype(np.float32)

    def step() -> None:
        envs.reset(seed=0)
        for action in actions:
            envs.step(action)

    print(f"{'Grasp-v0':22}{1e3 * least(step, args.repeats) / (STEPS * ENVS):8.3f} ms a step of an environment")


if __name__ == "__main__":
    run_program(main)
