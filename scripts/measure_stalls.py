"""Measure the first observation and the slowest steps of a vector environment.

The rows are an empty cache, a filled one, and one after ``prepare``, each in a process of its own with random actions.
The first columns are the processor time from the making of the environment to its first observation, and the memory by
which the process grew until the last step. The first reset prepares a set with mesh files; other objects are prepared
while episodes run. Run it on an idle machine::

    python scripts/measure_stalls.py --objects ycb --num-envs 16
    python scripts/measure_stalls.py --env graspbox/Clear-v0 --objects procedural:seen:0-19 --layout pile --num-envs 4
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import gymnasium as gym
import numpy as np

import graspbox  # noqa: F401 (registers the environments)
from graspbox._common.programs import run_program


def resident() -> float:
    """Return the memory of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 1e-6 * pages * resource.getpagesize()


def measure(args: argparse.Namespace, prepare: bool) -> dict[str, float]:
    """Step an environment; returns processor time, memory (MB), and seconds of preparation, reset and steps."""
    began, memory = time.process_time(), resident()
    envs = gym.make_vec(
        args.env,
        num_envs=args.num_envs,
        objects=args.objects,
        obs=args.obs,
        image_size=64,
        layout=args.layout,
        max_episode_steps=args.episode_steps,
    )
    start = time.perf_counter()
    if prepare:
        envs.prepare(progress=True)  # type: ignore[attr-defined]
    prepared = time.perf_counter()
    envs.reset(seed=0)
    begun, spent = time.perf_counter(), time.process_time() - began
    rng = np.random.default_rng(0)
    times = []
    for _ in range(args.steps):
        actions = rng.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32)
        before = time.perf_counter()
        envs.step(actions)
        times.append(time.perf_counter() - before)
    return {
        "processor": spent,
        "MB": 1e-3 * (resident() - memory),
        "prepare": prepared - start,
        "reset": begun - prepared,
        "mean": float(np.mean(times)),
        "median": float(np.median(times)),
        "99 %": float(np.quantile(times, 0.99)),
        "slowest": max(times),
    }


def main() -> None:
    """Run every row and print a table: milliseconds, but for memory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="graspbox/Grasp-v0", help="environment")
    parser.add_argument("--objects", default="ycb", help="object set")
    parser.add_argument("--layout", default="single", help="layout of the objects")
    parser.add_argument("--num-envs", type=int, default=16, help="environments")
    parser.add_argument("--obs", default="state", help="observation")
    parser.add_argument("--steps", type=int, default=400, help="steps of every environment")
    parser.add_argument("--episode-steps", type=int, default=50, help="steps of an episode")
    parser.add_argument("--row", choices=("plain", "prepared"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.row:
        print(json.dumps(measure(args, args.row == "prepared")))
        return
    rows = {"empty cache": "plain", "filled cache": "plain", "prepared": "prepared"}
    columns = ("processor", "MB", "prepare", "reset", "mean", "median", "99 %", "slowest")
    print(f"{'milliseconds':14}" + "".join(f"{name:>10}" for name in columns))
    with tempfile.TemporaryDirectory() as cache:
        for name, row in rows.items():
            command = [sys.executable, __file__, *sys.argv[1:], "--row", row]
            done = subprocess.run(
                command, env={**os.environ, "GRASPBOX_CACHE": cache}, stdout=subprocess.PIPE, check=True, text=True
            )
            numbers = json.loads(done.stdout)
            print(f"{name:14}" + "".join(f"{1e3 * value:10.1f}" for value in numbers.values()), flush=True)


if __name__ == "__main__":
    run_program(main)
