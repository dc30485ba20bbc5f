"""Measure the processor time of trials and of environment steps with a single object, or of plans, on one thread.

Run it in two checkouts in turn, each with its own build, to compare them::

    python scripts/measure_trials.py
    python scripts/measure_trials.py --hand panda_gripper --repeats 9

Plans are compared in one run, object by object and in turn, with those of another build, given by the folder of its
package ``graspbox``. The first plan of an object also prepares its surface for the collision filter::

    python scripts/measure_trials.py --plans ycb --beside ../main/python
"""

import argparse
import contextlib
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def answer_plans(objects: str, hand: str, repeats: int) -> None:
    """Read numbers of objects of a set; write the milliseconds of plans, the volume of the boxes and a hash of all."""
    items = graspbox.object_sets.load(objects)
    for line in sys.stdin:
        mesh = items[int(line)].load()
        world_from_object = graspbox.Scene(mesh, hand=hand).world_from_object

        def plan(mesh: graspbox.Mesh = mesh, world_from_object: Any = world_from_object) -> graspbox.Plan:
            return graspbox.plan(mesh, hand=hand, world_from_object=world_from_object, num_threads=1)

        begin = time.process_time()
        made = plan()
        first = time.process_time() - begin
        columns = (made.poses, made.preshape, made.feasible, made.score, made.box, made.face, made.tree.children)
        sizes = [2 * box.half_extents for box in made.tree]
        bits = hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in (*columns, sizes)))
        volume = float(sum(np.prod(size) for size in sizes))
        row = {"first": 1e3 * first, "plan": 1e3 * least(plan, repeats), "volume": volume, "bits": bits.hexdigest()}
        print(json.dumps(row), flush=True)


def ask(child: subprocess.Popen[str], number: int) -> dict[str, Any]:
    """Ask a process of `answer_plans` about an object."""
    assert child.stdin is not None
    assert child.stdout is not None
    print(number, file=child.stdin, flush=True)
    answer: dict[str, Any] = json.loads(child.stdout.readline())
    return answer


def compare_plans(args: argparse.Namespace) -> None:
    """Print the plans of each object in this build and, with ``--beside``, in the other one, and the medians."""
    options = {"--plans": args.plans, "--hand": args.hand, "--repeats": str(args.repeats)}
    command = [sys.executable, __file__, "--answer", *(word for pair in options.items() for word in pair)]
    builds = [Path(graspbox.__file__).parents[1], *([args.beside] if args.beside else [])]
    names = [item.name for item in graspbox.object_sets.load(args.plans)]
    rows: list[list[dict[str, Any]]] = []
    with contextlib.ExitStack() as stack:
        children: list[subprocess.Popen[str]] = []
        for build in builds:
            env = {**os.environ, "PYTHONPATH": str(build.resolve())}
            child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)
            children.append(stack.enter_context(child))
        for number, name in enumerate(names):
            row = [ask(child, number) for child in children]
            rows.append(row)
            times = "".join(f"{each['first']:9.1f}{each['plan']:9.1f}" for each in row)
            print(
                f"{name:34}{times} ms{'' if len({each['bits'] for each in row}) == 1 else '  other bits'}", flush=True
            )
    for number, build in enumerate(builds):
        first, plan = ([row[number][key] for row in rows] for key in ("first", "plan"))
        times = f"first {np.median(first):.1f}, repeated {np.median(plan):.1f} (median), {max(plan):.1f} ms (most)"
        print(f"{build}: {times}, boxes of {1e3 * sum(row[number]['volume'] for row in rows):.6f} l")
    if args.beside:
        ratios = [[row[0][key] / row[1][key] for row in rows] for key in ("first", "plan")]
        print(
            f"ratio to the other build, median: first {np.median(ratios[0]):.2f}, repeated {np.median(ratios[1]):.2f}"
        )


def main() -> None:
    """Print milliseconds of a trial with each object, and of a step of an environment, or of plans."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hand", default="reflex", help="hand")
    parser.add_argument("--arm", help="arm that carries the hand in the environments")
    parser.add_argument("--repeats", type=int, default=5, help="runs, of which the fastest counts")
    parser.add_argument("--plans", metavar="OBJECTS", help="measure plans of this set of objects")
    parser.add_argument("--beside", type=Path, metavar="FOLDER", help="folder of another build's package, for plans")
    parser.add_argument("--answer", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.answer:
        return answer_plans(args.plans, args.hand, args.repeats)
    if args.plans:
        return compare_plans(args)
    measure_trials(args)
    return None


def measure_trials(args: argparse.Namespace) -> None:
    """Print milliseconds of a trial with each object, and of a step of an environment."""
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
    for row, rate in (("20 Hz", 20), ("5 Hz", 5)):
        for motion in ("hovering", "random actions"):
            each = 1e6 * step_time(args, rate, motion)
            print(
                f"{f'Grasp-v0, {row}, {motion}':32}{each:8.1f} us a step of an environment, {1 / (1e-6 * each):.0f} /s"
            )


def step_time(args: argparse.Namespace, rate: int, motion: str) -> float:
    """Return the processor time of an environment's step, seconds: the hand stays, open, or moves at random."""
    settings = {
        "objects": "procedural:mug:0-9",
        "hand": args.hand,
        "num_threads": 1,
        "control_freq": rate,
        "obs": "state",
    }
    if args.arm is not None:
        settings["arm"] = args.arm
    envs = gym.make_vec("graspbox/Grasp-v0", num_envs=ENVS, **settings)
    shape = (STEPS, *(envs.action_space.shape or ()))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    if motion == "hovering":
        # Nothing moves the hand; the fingers stay open.
        actions[..., :6], actions[..., 6:] = 0.0, -1.0

    def step() -> None:
        envs.reset(seed=0)
        for action in actions:
            envs.step(action)

    return least(step, args.repeats) / (STEPS * ENVS)


if __name__ == "__main__":
    run_program(main)
