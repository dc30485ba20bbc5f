"""Profile of trials and of environment steps: instructions, counted by callgrind.

Counts do not depend on the load of the machine; they approximate times where the instruction mix is the same.

    python scripts/profile_step.py trials   # planner poses on a mug and an apple: a simulated second
    python scripts/profile_step.py expert   # 16 environments, observation state, scripted expert: an env-step
    python scripts/profile_step.py random   # 16 environments, observation voxels, random actions: an env-step

Needs ``valgrind`` and the extras ``cli`` and ``ycb``; takes some minutes. The objects of the environments are those of
``graspbox bench``.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import graspbox
from graspbox import object_sets, policies
from graspbox.cli import bench
from graspbox.policies import Task
from graspbox.programs import run_program

TRIAL_OBJECTS, TRIAL_POSES = ("ycb:025_mug", "ycb:013_apple"), 5
RANDOM_STEPS = 40

#: Functions by the ends of their names, as callgrind prints them. The row of an inlined function is 0, and its caller's
#: is larger.
STEP, WORLD = "Solver::step", "World::step"
FIND, SEARCH = "Solver::find_contacts", "PersistentQueryDispatcher<M,C>>::contact_manifold_convex_convex"
EVALUATE, DIFFERENTIATE = "Problem::evaluate", "Problem::differentiate"
SOLVE = ("Newton::coulomb", "Newton::convex", "Newton::quiet", "Newton::begin")
EQUATIONS = ("Factors::solve", "Matrix::solve_definite", "Matrix::factor")
RENDER, FUSE, AGENT = "Renderer::render_into", "occupancy::occupancy_into", "AgentEpisode::step"
TRIAL, ENVIRONMENT = "Episode::advance", "env::Env::step"

_COST = re.compile(r"^\s*([\d,]+) \([^)]*\)\s+([*>])\s+(.*?)(?: \([\d,]+x\))?(?: \[.*\])?$")


def trials(path: str | None) -> float:
    """Try planner poses on one thread; returns the number of simulated seconds."""
    seconds = 0.0
    for item in object_sets.load(list(TRIAL_OBJECTS)):
        scene = graspbox.Scene(item.load())
        plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=0).best(TRIAL_POSES)
        seconds += float(scene.simulate(plan.poses, plan.preshape, num_threads=1).time.sum())
    return seconds


def environments(obs: str, threads: int | None = None) -> Any:
    """Make the environments of ``graspbox bench``."""
    settings: dict[str, Any] = {
        "objects": bench._OBJECTS,
        "autoreset_mode": "SameStep",
        "num_threads": threads,
        "obs": obs,
    }
    return gymnasium.make_vec("graspbox/Grasp-v0", num_envs=bench._ENVS, **settings)


def expert_actions() -> np.ndarray:
    """Actions of the policy ``planner``, (steps, envs, numbers)."""
    envs, policy = environments("state"), policies.load("planner")
    policy.bind(Task.of(envs))
    state, info = envs.reset(seed=0)
    taken, begin = [], np.ones(bench._ENVS, dtype=np.bool_)
    for _ in range(bench._STEPS):
        policy.reset(mask=begin, info=info)
        taken.append(policy.act(state))
        state, _, terminated, truncated, info = envs.step(taken[-1])
        begin = terminated | truncated
    return np.stack(taken)


def expert(path: str | None) -> float:
    """Step through saved actions on one thread; returns the number of env-steps. Without a file it saves them."""
    if path is None:
        raise ValueError("the actions of the expert are missing")
    envs, actions = environments("state", threads=1), np.load(path)
    envs.reset(seed=0)
    for action in actions:
        envs.step(action)
    return float(bench._ENVS * len(actions))


def random(path: str | None) -> float:
    """Take random actions on one thread; returns the number of env-steps."""
    envs, source = environments("voxels", threads=1), np.random.default_rng(0)
    envs.reset(seed=0)
    for _ in range(RANDOM_STEPS):
        envs.step(source.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32))
    return float(bench._ENVS * RANDOM_STEPS)


@dataclass(frozen=True)
class Work:
    """A profiled workload: its function, the counted calls, their unit, and whether it needs the expert's actions."""

    run: Callable[[str | None], float]
    counted: str
    unit: str
    needs_actions: bool = False


WORK = {
    "trials": Work(trials, TRIAL, "simulated second"),
    "expert": Work(expert, ENVIRONMENT, "env-step", needs_actions=True),
    "random": Work(random, ENVIRONMENT, "env-step"),
}


@dataclass
class Counts:
    """Instructions: of functions with their callees, and of calls by caller and callee."""

    total: dict[str, int]
    calls: dict[tuple[str, str], int]
    units: float

    def whole(self, *ends: str) -> int:
        """Sum over the functions whose names have this ending."""
        return sum(cost for name, cost in self.total.items() if name.endswith(ends))

    def within(self, caller: str | tuple[str, ...], *ends: str) -> int:
        """Sum over the calls from `caller`."""
        return sum(cost for (a, b), cost in self.calls.items() if a.endswith(caller) and b.endswith(ends))


def count(name: str, folder: Path) -> Counts:
    """Run a workload under callgrind."""
    work, out, actions = WORK[name], folder / "callgrind.out", folder / "actions.npy"
    if work.needs_actions:
        np.save(actions, expert_actions())
    tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", f"--toggle-collect=*{work.counted}*"]
    run = [*tool, sys.executable, __file__, name, "--actions", str(actions)]
    units = float(subprocess.run(run, check=True, capture_output=True, text=True).stdout)
    show = ["callgrind_annotate", "--inclusive=yes", "--tree=calling", "--threshold=100", str(out)]
    text = subprocess.run(show, check=True, capture_output=True, text=True).stdout
    counts, caller = Counts(defaultdict(int), defaultdict(int), units), ""
    for line in text.splitlines():
        if (found := _COST.match(line)) is None:
            continue
        cost, kind, function = found.groups()
        function = function.removeprefix("???:").split(" [")[0]
        if kind == "*":
            caller = function
            counts.total[function] += int(cost.replace(",", ""))
        else:
            counts.calls[caller, function] += int(cost.replace(",", ""))
    return counts


def parts(name: str, counts: Counts) -> list[tuple[str, int]]:
    """Split the instructions."""
    whole, within = counts.whole, counts.within
    newton = within(STEP, *SOLVE, EVALUATE, DIFFERENTIATE, *EQUATIONS)
    forces, slopes, equations = whole(EVALUATE), whole(DIFFERENTIATE), whole(*EQUATIONS)
    rows = [
        ("contact forces and residual", forces),
        ("derivative", slopes),
        ("linear equations", equations),
        ("Newton's method, the rest of it", newton - forces - slopes - equations),
        ("contact search: manifolds of convex parts", whole(SEARCH)),
        ("contact search: which pairs, corners over planes, contact points", whole(FIND) - whole(SEARCH)),
        ("kinematics, mass matrix, bias, integration", whole(STEP) - newton - whole(FIND)),
        ("actuators and the moving frame", whole(WORLD) - whole(STEP)),
    ]
    if name == "trials":
        return [*rows, ("judge and the queries of the trial", whole(TRIAL) - whole(WORLD))]
    every, images = whole(ENVIRONMENT), whole(RENDER) + whole(FUSE)
    return [
        *rows,
        ("judge, arm, protective stop, reward", whole(AGENT) - whole(WORLD)),
        ("depth images", whole(RENDER)),
        ("voxels", whole(FUSE)),
        ("resets and observations without images", every - whole(AGENT) - images),
    ]


def main(name: str) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        counts = count(name, Path(folder))
    every = counts.whole(WORK[name].counted)
    if not every:
        raise SystemExit(
            f"no function {WORK[name].counted!r} was counted: build the extension with symbols, by `make test`"
        )
    each = every / counts.units / 1e6
    table = Table("part", "share, %", title=f"{each:.1f} million instructions per {WORK[name].unit}")
    for part, cost in parts(name, counts):
        table.add_row(part, f"{100 * cost / every:.0f}")
    Console().print(table)


def program() -> None:
    """Parse the arguments and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=list(WORK), help="workload to profile")
    parser.add_argument("--actions", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.actions is None:
        main(given.work)
    else:
        print(WORK[given.work].run(given.actions))


if __name__ == "__main__":
    run_program(program)
