"""Compare the scripted expert of Grasp-v0 with trials of `graspbox.simulate` at the same grasp poses.

In each episode the planner proposes poses for the resting object. One of the best three is tried twice: by
`graspbox.simulate`, and by the expert, which moves the hand there by actions only. An episode is left out if no pose
is feasible, or if the trial's object, settled anew, comes to rest elsewhere.

    python scripts/expert_rates.py --episodes 120 procedural ycb:025_mug ycb:005_tomato_soup_can

Needs the extras ``cli`` and, for YCB objects, ``ycb``.
"""

from functools import partial
from typing import Annotated, Any

import gymnasium
import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

import graspbox
from graspbox._common.programs import run_program
from graspbox.envs.coding import object_pose
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.envs.scripted import MotionOptions
from graspbox.policies import Task
from graspbox.policies.base import SCRIPTED

#: Greatest difference between entries of the object's resting poses in trial and environment (m, or 1).
SAME = 5e-3


def compare(env: Any, seed: int) -> dict[str, Any] | None:
    """Try one pose both ways; None if the episode is left out."""
    task = Task.of(env)
    control = task.control
    state, info = env.reset(seed=seed)
    name = info["object"]
    mesh = env.objects[env.objects.names.index(name)].load()
    pose = object_pose(state, control=control)
    plan = planned(mesh, state, control=control, seed=seed)
    scene = graspbox.Scene(mesh, world_from_object=pose)
    if not len(plan) or np.abs(scene.world_from_object - pose).max() > SAME:
        return None
    chosen = seed % min(3, len(plan))
    trial = scene.simulate(plan.poses[chosen : chosen + 1], plan.preshape[chosen : chosen + 1])
    options = MotionOptions(control=control, fingers=task.fingers, control_freq=task.control_freq)
    expert = ExpertGrasp(state, plan.poses[chosen], plan.preshape[chosen], **options)
    steps, touches, done = 0, 0, False
    while not done and not expert.finished:
        state, _, done, _, info = env.step(expert.act(state))
        steps += 1
        touches += info["touches"]
    row = {"seed": seed, "object": name, "expert": info["is_success"], "trial": bool(trial.success[0])}
    row |= {"failure": info["failure"], "trial_failure": str(trial.failure[0])}
    return {**row, "steps": steps, "touches": touches}


def rates(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return success rates of both, their agreement, steps per episode, and the share of steps with contact."""
    steps = sum(row["steps"] for row in rows)
    return {
        "episodes": len(rows),
        "expert": float(np.mean([row["expert"] for row in rows])),
        "trial": float(np.mean([row["trial"] for row in rows])),
        "agreement": float(np.mean([row["expert"] == row["trial"] for row in rows])),
        "steps": steps / len(rows),
        "contact": sum(row["touches"] for row in rows) / steps,
    }


def main(
    objects: Annotated[list[str], typer.Argument(help="Object sets.")],
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 120,
    control: Annotated[str, typer.Option(help="Control mode.")] = "twist",
) -> None:
    """Compare the expert with the planner's own trials."""
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects=objects, control=control, **SCRIPTED).unwrapped
    rows = [row for seed in track(range(episodes), console=Console(stderr=True)) if (row := compare(env, seed))]
    if not rows:
        raise typer.BadParameter("the planner finds no feasible pose for any of these objects")
    table = Table("seed", "object", "expert", "trial", title="episodes in which they differ", title_justify="left")
    for row in rows:
        if row["expert"] != row["trial"]:
            table.add_row(
                str(row["seed"]), row["object"], row["failure"] or "success", row["trial_failure"] or "success"
            )
    console = Console()
    console.print(table)
    for name, value in rates(rows).items():
        console.print(f"{name}: {value:.3g}")


if __name__ == "__main__":
    run_program(partial(typer.run, main))
