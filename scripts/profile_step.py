"""Profile of a physics step: instructions of 16 environments under the scripted expert, counted by callgrind.

Objects, number of environments and steps are those of ``graspbox bench``. Counts do not depend on the load of the
machine; they approximate times where the instruction mix is the same.

    python scripts/profile_step.py

Needs ``valgrind`` and the extras ``cli`` and ``ycb``; takes some minutes.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

from graspbox import policies
from graspbox.cli import bench_images as bench
from graspbox.policies import Task

#: Functions by the ends of their names, as callgrind prints them.
EPISODE, WORLD = "agent_episode::AgentEpisode::step", "world::World::step"
ENGINE, SOLVE, SEARCH = (
    "PhysicsPipeline>::step_inner",
    "StagedIslandSolver>::init_and_solve",
    "NarrowPhase>::compute_contacts",
)
MASSES = ("Multibody::update_mass_matrix",)
MOTIONS = ("Multibody::forward_kinematics", "Multibody::update_acceleration", "Multibody::update_velocities")

_COST = re.compile(r"^\s*([\d,]+) \([^)]*\)\s+([*>])\s+(.*?)(?: \([\d,]+x\))?(?: \[.*\])?$")


def environments(threads: int | None = None) -> Any:
    """Make the environments of ``graspbox bench``."""
    settings = {"objects": bench._OBJECTS, "autoreset_mode": "SameStep", "num_threads": threads}
    return gymnasium.make_vec("graspbox/Grasp-v0", num_envs=bench._ENVS, **settings)


def actions() -> np.ndarray:
    """Actions of the policy ``planner``, (steps, envs, numbers)."""
    envs, policy = environments(), policies.load("planner")
    policy.bind(Task.of(envs))
    state, info = envs.reset(seed=0)
    taken, begin = [], np.ones(bench._ENVS, dtype=np.bool_)
    for _ in range(bench._STEPS):
        policy.reset(mask=begin, info=info)
        taken.append(policy.act(state))
        state, _, terminated, truncated, info = envs.step(taken[-1])
        begin = terminated | truncated
    return np.stack(taken)


def replay(path: str) -> None:
    """Step through saved actions on one thread."""
    envs = environments(threads=1)
    envs.reset(seed=0)
    for action in np.load(path):
        envs.step(action)


def counted(folder: Path) -> tuple[dict[str, int], dict[tuple[str, str], int]]:
    """Inclusive instructions per function, and per call."""
    np.save(folder / "actions.npy", actions())
    out = folder / "callgrind.out"
    tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", f"--toggle-collect=*{EPISODE}"]
    subprocess.run([*tool, sys.executable, __file__, str(folder / "actions.npy")], check=True, capture_output=True)
    show = ["callgrind_annotate", "--inclusive=yes", "--tree=calling", "--threshold=100", str(out)]
    text = subprocess.run(show, check=True, capture_output=True, text=True).stdout
    total: dict[str, int] = defaultdict(int)
    calls: dict[tuple[str, str], int] = defaultdict(int)
    caller = ""
    for line in text.splitlines():
        if (found := _COST.match(line)) is None:
            continue
        cost, kind, name = found.groups()
        name = name.removeprefix("???:").split(" [")[0]
        if kind == "*":
            caller = name
            total[name] += int(cost.replace(",", ""))
        else:
            calls[caller, name] += int(cost.replace(",", ""))
    return total, calls


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        total, calls = counted(Path(folder))
    if not total:
        raise SystemExit(f"no function {EPISODE!r} was counted: build the extension with symbols, by `make test`")

    def whole(*ends: str) -> int:
        return sum(cost for name, cost in total.items() if name.endswith(ends))

    def outside(*ends: str) -> int:
        return sum(cost for (a, b), cost in calls.items() if a.endswith(ENGINE) and b.endswith(ends))

    # The kinematics are also computed once before the solver.
    before = outside(*MOTIONS)
    inside = whole(*MASSES, *MOTIONS) - before
    rows = [
        ("fingers' mass matrices, at every solver sub-step", whole(*MASSES)),
        ("fingers' kinematics, velocities and accelerations", whole(*MOTIONS)),
        ("searches for contacts", whole(SEARCH)),
        ("contact constraints and integration", whole(SOLVE) - inside),
        ("candidates, islands and the rest of the engine", whole(ENGINE) - whole(SEARCH) - whole(SOLVE) - before),
        ("tendons, actuators and the moving frame", whole(WORLD) - whole(ENGINE)),
        ("judge, arm, protective stop, reward", whole(EPISODE) - whole(WORLD)),
    ]
    each = whole(EPISODE) / (bench._ENVS * bench._STEPS) / 1e6
    table = Table("part", "share, %", title=f"{each:.1f} million instructions per env-step")
    for part, cost in rows:
        table.add_row(part, f"{100 * cost / whole(EPISODE):.0f}")
    Console().print(table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("actions", nargs="?", help="step through this file of actions; the program itself does so")
    given = parser.parse_args().actions
    main() if given is None else replay(given)
