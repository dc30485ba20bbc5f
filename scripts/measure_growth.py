"""Measure how speed and memory change with the size of the work, beside other programs where they do the same.

    python scripts/measure_growth.py --json out/growth.json --picture docs/pictures/growth.png
    python scripts/measure_growth.py --only scene --only set
    python scripts/measure_growth.py --only envs --envpool-python PATH   # an interpreter that has EnvPool

| part | sizes | rival |
|---|---|---|
| envs | 1 to 1,024 environments of `Grasp-v0`, `panda_gripper`, 50 Hz, random actions | EnvPool's `PandaPickCube-v1` |
| scene | piles of 1 to 40 objects, a planner pose for each | `mujoco.rollout` of the same commands |
| set | 25 to 10,000 objects, until the first observation of 16 environments | |
| pixels | depth images of 32 to 256 pixels, 16 environments | |
| sessions | 1 to 64 sessions of a server, which share 64 environments | |

Each point is the median of ``--runs`` processes, and rivals take turns. Run it on an idle machine; Linux. ``scene``
needs the extra ``dev``, and ``sessions`` cargo.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import graspbox  # noqa: F401 (registers the environments)
from graspbox._common.options import parse
from graspbox._common.programs import run_program
from measure_stalls import resident
from servers.processes import served

#: Environments of the parts that do not vary their number.
ENVS = 16
#: Most environments of EnvPool: each takes 20 MB.
MOST_ENVPOOL = 256
#: Seconds of a measurement.
SECONDS = 3.0
#: Families whose objects make up a set.
FAMILIES = 25


def steps(env: Any, seconds: float = SECONDS) -> float:
    """Return the environment steps per second of a vector environment under random actions."""
    env.reset(seed=0)
    low, high = env.single_action_space.low, env.single_action_space.high
    actions = np.random.default_rng(0).uniform(low, high, (64, env.num_envs, low.size)).astype(np.float32)
    for action in actions[:5]:
        env.step(action)
    began, count = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        env.step(actions[count % len(actions)])
        count += 1
    return float(env.num_envs * count / (time.perf_counter() - began))


def envs(count: int) -> dict[str, float]:
    """Step `count` environments."""
    settings: dict[str, Any] = {
        "objects": "procedural:box:0-3",
        "hand": "panda_gripper",
        "control_freq": 50,
        "obs": "state",
    }
    return {"env-steps/s": steps(gym.make_vec("graspbox/Grasp-v0", count, **settings))}


#: The same with EnvPool, for an interpreter without graspbox.
ENVPOOL = """
import json, os, sys, time, envpool, numpy as np
count, seconds = int(sys.argv[1]), float(sys.argv[2])
threads = min(count, len(os.sched_getaffinity(0)))
env = envpool.make_gymnasium("PandaPickCube-v1", num_envs=count, num_threads=threads, seed=0)
env.reset()
shape = (64, count, *env.action_space.shape)
actions = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(env.action_space.dtype)
for action in actions[:5]:
    env.step(action)
began, done = time.perf_counter(), 0
while time.perf_counter() - began < seconds:
    env.step(actions[done % 64])
    done += 1
print(json.dumps({"EnvPool": count * done / (time.perf_counter() - began)}))
"""


def scene(count: int) -> dict[str, float]:
    """Try a pose for each object of piles of `count`, here and in MuJoCo."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from validation import speed

    rows = {row.engine: row for row in speed.measure(f"piles of {count}", 1, 0, "panda_gripper")}
    rates = {name: rows[name].simulated_per_second for name in ("implicit", "mujoco, fast")}
    return {"simulated s/s": rates["implicit"], "MuJoCo": rates["mujoco, fast"]}


def set_of(count: int) -> dict[str, float]:
    """Make environments of a set, and wait for the first observation."""
    each = -(-count // FAMILIES)
    began, memory = time.process_time(), resident()
    env = gym.make_vec("graspbox/Grasp-v0", ENVS, objects=f"procedural:0-{each - 1}", obs="state")
    env.reset(seed=0)
    return {"processor s": time.process_time() - began, "MB": resident() - memory}


def pixels(side: int) -> dict[str, float]:
    """Step environments that see depth images."""
    settings: dict[str, Any] = {"objects": "procedural:box:0-3", "obs": "depth", "image_size": side}
    return {"env-steps/s": steps(gym.make_vec("graspbox/Grasp-v0", ENVS, **settings))}


def sessions(count: int) -> dict[str, float]:
    """Step 64 environments of a server in `count` sessions, each a client of its own."""
    call = ["cargo", "run", "--release", "--quiet", "-p", "graspbox-server", "--example", "load_clients", "--"]
    with served("--objects", "procedural") as server:
        words = [*call, server.url, str(count), str(64 // count), "200"]
        done = subprocess.run(words, check=True, capture_output=True, text=True)
    return {"env-steps/s": float(done.stdout)}


#: By part: its function, its sizes, and the names of its axes.
PARTS: dict[str, tuple[Callable[[int], dict[str, float]], tuple[int, ...], str]] = {
    "envs": (envs, (1, 4, 16, 64, 256, 1024), "environments"),
    "scene": (scene, (1, 2, 5, 10, 20, 40), "objects in a pile"),
    "set": (set_of, (25, 100, 1000, 10_000), "objects of a set"),
    "pixels": (pixels, (32, 64, 128, 256), "pixels of a side"),
    "sessions": (sessions, (1, 4, 16, 64), "sessions of a server"),
}


@dataclass
class Args:
    """Measurements."""

    only: tuple[str, ...] = ()
    """Parts: envs, scene, set, pixels, sessions. All by default."""
    runs: int = 3
    """Processes of each point, of which the median counts."""
    envpool_python: str = ""
    """An interpreter that has EnvPool, for its rate beside the part envs."""
    json: Path | None = None
    """Write the figures into this file."""
    picture: Path | None = None
    """Draw the curves into this file."""
    point: str = ""
    """A part and a size, as in envs:16: print its figures as JSON."""


def answer(command: list[str]) -> dict[str, float]:
    """Run a process that prints figures in its last line."""
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


def measure(name: str, size: int, args: Args) -> dict[str, float]:
    """Measure a point: the medians of its figures."""
    own = [sys.executable, __file__, "--point", f"{name}:{size}"]
    other = [args.envpool_python, "-c", ENVPOOL, str(size), str(SECONDS)]
    if name == "set":
        answer(own)  # fills the cache
    with_rival = name == "envs" and args.envpool_python and size <= MOST_ENVPOOL
    runs = [{**answer(own), **(answer(other) if with_rival else {})} for _ in range(args.runs)]
    return {key: float(np.median([run[key] for run in runs])) for key in runs[0]}


def draw(rows: dict[str, list[dict[str, float]]], path: Path) -> None:
    """Draw the curves of all parts."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

    figure = Figure(figsize=(3.2 * len(rows), 3.0), layout="constrained")
    for axes, (name, points) in zip(np.ravel(figure.subplots(1, len(rows))), rows.items(), strict=True):
        for key in (key for key in points[0] if key != "size"):
            shown = [point for point in points if key in point]
            axes.plot([point["size"] for point in shown], [point[key] for point in shown], "o-", label=key)
        axes.set(xscale="log", yscale="log", xlabel=PARTS[name][2])
        sizes = [point["size"] for point in points]
        axes.set_xticks(sizes, [f"{size:,}" for size in sizes], fontsize="small")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:,g}")
        axes.set_ylim(bottom=0.5 * axes.get_ylim()[0])
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_locator(NullLocator())
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main(args: Args) -> None:
    """Measure, print a table of each part, and draw."""
    if args.point:
        part, _, number = args.point.partition(":")
        print(json.dumps(PARTS[part][0](int(number))))
        return
    if unknown := [name for name in args.only if name not in PARTS]:
        raise SystemExit(f"there is no part {unknown[0]!r}; choose from {', '.join(PARTS)}")
    rows: dict[str, list[dict[str, float]]] = {}
    for name in args.only or PARTS:
        rows[name] = []
        for size in PARTS[name][1]:
            rows[name].append({"size": size, **measure(name, size, args)})
            print(name, " ".join(f"{key} {value:.4g}" for key, value in rows[name][-1].items()), flush=True)
    if args.json is not None:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    if args.picture is not None:
        draw(rows, args.picture)


if __name__ == "__main__":
    run_program(lambda: main(parse(Args, text=__doc__)))
