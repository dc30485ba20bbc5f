"""Profile of trials and of environment steps: instructions, counted by callgrind.

Counts do not depend on the load of the machine; they approximate times where the instruction mix is the same.

    python scripts/profile_step.py trials   # planner poses on a mug and an apple: a simulated second
    python scripts/profile_step.py random   # 16 environments, observation voxels, random actions: an env-step

Needs ``valgrind`` and the extras ``cli`` and ``ycb``; takes some minutes.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import graspbox
from graspbox import object_sets
from graspbox._common.programs import run_program
from graspbox.cli.common import print_table

TRIAL_OBJECTS, TRIAL_POSES = ["ycb:025_mug", "ycb:013_apple"], 5
STEP_OBJECTS = ["ycb:003_cracker_box", "ycb:005_tomato_soup_can", "ycb:006_mustard_bottle", "ycb:025_mug"]
ENVS, STEPS = 16, 40

#: Functions by the ends of their names, as callgrind prints them. The row of an inlined function is 0, and its caller's
#: is larger.
STEP, WORLD = "Solver::step", "World::step"
FIND, SEARCH = "Solver::find_contacts", "PersistentQueryDispatcher<M,C>>::contact_manifold_convex_convex"
EVALUATE, DIFFERENTIATE = "Problem::evaluate", "Problem::differentiate"
SOLVE = tuple(
    f"Newton::{name}"
    for name in ("solve", "start", "reuse_factors", "newton", "convex_step", "solve_direction", "solve_convex")
)
EQUATIONS = ("Factors::solve", "Matrix::solve_definite", "Matrix::factor")
RENDER, FUSE, AGENT = "Renderer::render_into", "occupancy::occupancy_into", "EnvEpisode::step"
#: The counted function of each workload, and its unit.
COUNTED = {"trials": ("Episode::advance", "simulated second"), "random": ("env::Env::step", "env-step")}

_COST = re.compile(r"^\s*([\d,]+) \([^)]*\)\s+([*>])\s+(.*?)(?: \([\d,]+x\))?(?: \[.*\])?$")


def trials() -> float:
    """Try planner poses on one thread; returns the number of simulated seconds."""
    seconds = 0.0
    for item in object_sets.load(TRIAL_OBJECTS):
        scene = graspbox.Scene(item.load())
        plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=0).best(TRIAL_POSES)
        seconds += float(scene.simulate(plan.poses, plan.preshape, num_threads=1).time.sum())
    return seconds


def random() -> float:
    """Take random actions on one thread; returns the number of env-steps."""
    settings = {"objects": STEP_OBJECTS, "obs": "voxels", "num_threads": 1, "autoreset_mode": "SameStep"}
    settings |= {"fingers": "each", "control_freq": 20}
    envs, source = gymnasium.make_vec("graspbox/Grasp-v0", ENVS, **settings), np.random.default_rng(0)
    envs.reset(seed=0)
    for _ in range(STEPS):
        envs.step(source.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32))
    return float(ENVS * STEPS)


def count(name: str, out: Path) -> tuple[Callable[..., int], int, float]:
    """Run a workload under callgrind.

    Returns a function that sums the instructions of functions, with their callees, by the ends of their names; the
    instructions of Newton's method; and the units of work.
    """
    tool = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", f"--toggle-collect=*{COUNTED[name][0]}*"]
    run = [*tool, sys.executable, __file__, name, "--count"]
    units = float(subprocess.run(run, check=True, capture_output=True, text=True).stdout)
    show = ["callgrind_annotate", "--inclusive=yes", "--tree=calling", "--threshold=100", str(out)]
    text = subprocess.run(show, check=True, capture_output=True, text=True).stdout
    costs: list[tuple[str, int]] = []
    newton, caller = 0, ""
    for cost, kind, symbol in (match.groups() for match in map(_COST.match, text.splitlines()) if match):
        function, instructions = symbol.removeprefix("???:").split(" [")[0], int(cost.replace(",", ""))
        if kind == "*":
            caller = function
            costs.append((function, instructions))
        elif caller.endswith(STEP) and function.endswith((*SOLVE, EVALUATE, DIFFERENTIATE, *EQUATIONS)):
            newton += instructions
    return lambda *ends: sum(cost for name, cost in costs if name.endswith(ends)), newton, units


def parts(name: str, whole: Callable[..., int], newton: int) -> list[tuple[str, int]]:
    """Split the instructions."""
    forces, slopes, equations = whole(EVALUATE), whole(DIFFERENTIATE), whole(*EQUATIONS)
    every = whole(COUNTED[name][0])
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
        return [*rows, ("judge and the queries of the trial", every - whole(WORLD))]
    rest = every - whole(AGENT) - whole(RENDER) - whole(FUSE)
    rows += [("judge, arm, protective stop, reward", whole(AGENT) - whole(WORLD)), ("depth images", whole(RENDER))]
    return [*rows, ("voxels", whole(FUSE)), ("resets and observations without images", rest)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=list(COUNTED), help="workload to profile")
    parser.add_argument("--count", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.count:
        return print(trials() if arguments.work == "trials" else random())
    counted, unit = COUNTED[arguments.work]
    with tempfile.TemporaryDirectory() as folder:
        whole, newton, units = count(arguments.work, Path(folder) / "callgrind.out")
    every = whole(counted)
    if not every:
        raise SystemExit(f"no function {counted!r} was counted: build the extension with symbols, by `make test`")
    title = f"{every / units / 1e6:.1f} million instructions per {unit}"
    shares = [(part, f"{100 * cost / every:.0f}") for part, cost in parts(arguments.work, whole, newton)]
    return print_table(title, ("part", "share, %"), shares)


if __name__ == "__main__":
    run_program(main)
