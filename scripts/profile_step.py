"""Where a physics step's time goes: instructions of 16 environments under the expert, counted by callgrind.

The steps are those of ``graspbox bench``: its objects, and the actions that its expert takes. Counts do not depend on
what else the machine does; they are no times, but near them where the work is of one kind.

    python scripts/profile_step.py

Needs ``valgrind`` and the extras ``cli`` and ``ycb``; takes some minutes.
"""

import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from graspbox.cli import bench_images as bench
from graspbox.envs.vector import GraspVectorEnv

#: Functions by the ends of their names, as callgrind prints them.
PLAY, WORLD = "agent::play::Play::step", "world::World::step"
ENGINE, SOLVE, SEARCH = (
    "PhysicsPipeline>::step_inner",
    "StagedIslandSolver>::init_and_solve",
    "NarrowPhase>::compute_contacts",
)
MASSES = ("Multibody::update_mass_matrix",)
MOTIONS = ("Multibody::forward_kinematics", "Multibody::update_acceleration", "Multibody::update_velocities")

_COST = re.compile(r"^\s*([\d,]+) \([^)]*\)\s+([*>])\s+(.*?)(?: \([\d,]+x\))?(?: \[.*\])?$")


def actions() -> np.ndarray:
    """Take the expert's actions, (steps, envs, numbers)."""
    env = GraspVectorEnv(bench._ENVS, bench._OBJECTS, obs=("state",), max_episode_steps=200)
    seen, info = env.reset(seed=0)
    experts = [bench._expert(env, name, state) for name, state in zip(info["object"], seen["state"], strict=True)]
    taken = []
    ended = np.zeros(bench._ENVS, dtype=np.bool_)
    for _ in range(bench._STEPS):
        acts = [expert.act(state) for expert, state in zip(experts, seen["state"], strict=True)]
        taken.append(np.stack(acts).astype(np.float32))
        seen, _, terminated, truncated, info = env.step(taken[-1])
        for i in np.flatnonzero(ended):
            experts[i] = bench._expert(env, info["object"][i], seen["state"][i])
        ended = terminated | truncated
    return np.stack(taken)


def replay(path: str) -> None:
    """Take saved actions on one thread."""
    env = GraspVectorEnv(bench._ENVS, bench._OBJECTS, obs=("state",), max_episode_steps=200, num_threads=1)
    env.reset(seed=0)
    for action in np.load(path):
        env.step(action)


def counted(folder: Path) -> tuple[dict[str, int], dict[tuple[str, str], int]]:
    """Count instructions of each function with what it calls, and of each call."""
    np.save(folder / "actions.npy", actions())
    out = folder / "callgrind.out"
    tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", "--toggle-collect=*agent*play*Play*step*"]
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
        raise SystemExit("nothing was counted: the extension was stripped (profile dist); build it by `make test`")

    def whole(*ends: str) -> int:
        return sum(cost for name, cost in total.items() if name.endswith(ends))

    def outside(*ends: str) -> int:
        return sum(cost for (a, b), cost in calls.items() if a.endswith(ENGINE) and b.endswith(ends))

    # The kinematics are also found once before the solver.
    before = outside(*MOTIONS)
    inside = whole(*MASSES, *MOTIONS) - before
    rows = [
        ("fingers' mass matrices, at every solver sub-step", whole(*MASSES)),
        ("fingers' kinematics, velocities and accelerations", whole(*MOTIONS)),
        ("searches for contacts", whole(SEARCH)),
        ("contact constraints and integration", whole(SOLVE) - inside),
        ("candidates, islands and the rest of the engine", whole(ENGINE) - whole(SEARCH) - whole(SOLVE) - before),
        ("tendons, motors and the moving frame", whole(WORLD) - whole(ENGINE)),
        ("judge, arm, protective stop, reward", whole(PLAY) - whole(WORLD)),
    ]
    each = whole(PLAY) / (bench._ENVS * bench._STEPS) / 1e6
    table = Table("part", "share, %", title=f"{each:.1f} million instructions an env-step")
    for part, cost in rows:
        table.add_row(part, f"{100 * cost / whole(PLAY):.0f}")
    Console().print(table)


if __name__ == "__main__":
    replay(sys.argv[1]) if len(sys.argv) > 1 else main()
