"""Find the YCB objects that the hand can grasp at all; writes the list behind the object set ``ycb:graspable``.

Poses of an object are tried in ranking order, over plans with different seeds and no pose twice, until one succeeds. An
object is left out after 2,000 different feasible poses without a success; the list gives the reason: too flat, too
large, too heavy. An interrupted run resumes; begin a new one after a change of planner or physics.

    python scripts/sweep_graspable.py --out out/graspable --list python/graspbox/object_sets/ycb/ycb_graspable.txt

The exit status is 1 if an object is left out for none of these reasons, or kept only because it has fewer than 2,000
poses; inspect these. Needs the extras ``cli`` and ``ycb``.
"""

from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.progress import Progress

import graspbox
from graspbox._common.files import write_text
from graspbox._common.programs import run_program
from graspbox._common.runs import Run
from graspbox.cli.common import console
from graspbox.configs import PlanConfig, PoseConfig
from graspbox.object_sets import ObjectSpec

#: Poses without a success after which an object counts as not graspable.
ENOUGH = 2000
#: Poses per call: few while a success is likely, then more, since threads idle only at the end of a call.
FIRST_BATCH, LARGEST_BATCH = 2, 64
#: Plans per object: bounds the sweep of an object with few poses per plan.
MOST_PLANS = 100
#: Later plans vary each pose more often, to find poses missing from the first plan.
MORE = PlanConfig(poses=PoseConfig(variations=32))

#: Length of a distal pad, metres: from above, fingers touch a lower object only with their tips.
FLAT = 0.026
#: Our choice, kg: a fingertip presses with 4.5 to 7 N, and the heaviest YCB objects that most poses lift have about
#: this mass.
HEAVY = 0.6
#: Our choice, metres: an object thicker than this in every direction does not fit between the fingers.
LARGE = 0.14


def reasons(scene: graspbox.Scene) -> list[str]:
    """Reasons why an object may be impossible to grasp: flat, large, heavy."""
    rest, mass = scene.world_from_object, scene.body.mass
    height = float(np.ptp((scene.mesh.vertices @ rest[:3, :3].T)[:, 2]))
    thickness = 2.0 * float(graspbox.decompose(scene.mesh, max_boxes=1)[0].half_extents.min())
    possible = {
        f"too flat ({1e3 * height:.0f} mm)": height < FLAT,
        f"too large ({1e3 * thickness:.0f} mm)": thickness > LARGE,
        f"too heavy ({mass:.2f} kg)": mass > HEAVY,
    }
    return [reason for reason, holds in possible.items() if holds]


def untried(scene: graspbox.Scene) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield the poses of an object in ranking order and their preshapes, plan by plan and no pose twice."""
    seen: set[bytes] = set()
    rest = scene.world_from_object
    for seed in range(MOST_PLANS):
        config = PlanConfig() if seed == 0 else MORE
        plan = graspbox.plan(scene.mesh, world_from_object=rest, config=config, seed=seed).best()
        keys = [p.tobytes() + q.tobytes() for p, q in zip(plan.poses, plan.preshape, strict=True)]
        new = [i for i, key in enumerate(keys) if key not in seen]
        seen.update(keys)
        yield plan.poses[new], plan.preshape[new]


def sweep(spec: ObjectSpec, progress: Progress) -> dict[str, Any]:
    """Try poses of one object until one succeeds or enough have failed; returns its row."""
    task = progress.add_task(spec.name, total=ENOUGH)
    scene = graspbox.Scene(spec.load())
    failures: Counter[str] = Counter()
    graspable, batch = None, FIRST_BATCH
    for poses, preshapes in untried(scene):
        while len(poses) and graspable is None:
            count = min(batch, ENOUGH - failures.total())
            out = scene.simulate(poses[:count], preshapes[:count])
            poses, preshapes, batch = poses[batch:], preshapes[batch:], min(2 * batch, LARGEST_BATCH)
            failures.update(map(str, out.failure[: out.success.argmax()] if out.success.any() else out.failure))
            graspable = True if out.success.any() else False if failures.total() >= ENOUGH else None
            progress.update(task, completed=failures.total())
        if graspable is not None:
            break
    progress.remove_task(task)
    why = {} if graspable else {"reasons": reasons(scene)}
    counts = {"failed": failures.total(), "failures": dict(sorted(failures.items()))}
    return {"name": spec.name, "graspable": graspable, **why, **counts}


def write_list(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the names of the graspable objects, and in comments the reasons for the others."""
    everything = all(row["graspable"] is not False for row in rows)
    lines = ["# YCB objects that the ReFlex hand can grasp; made by scripts/sweep_graspable.py."]
    lines.append("# Left out: none" if everything else "# Left out:")
    for row in rows:
        if row["graspable"] is False:
            why = ", ".join(row["reasons"]) or "no known reason"
            kinds = ", ".join(f"{count} {kind}" for kind, count in row["failures"].items())
            lines.append(f"# {row['name']}: {why}; of {row['failed']} poses {kinds}")
    lines += [row["name"] for row in rows if row["graspable"] is not False]
    write_text(path, "\n".join(lines) + "\n")


def main(
    out: Annotated[Path, typer.Option(help="Folder of the run; objects already tried are skipped.")],
    list_file: Annotated[Path, typer.Option("--list", help="File for the names of the graspable objects.")],
    objects: Annotated[str, typer.Option(help="The object set to sweep.")] = "ycb",
) -> None:
    """Sweep a set and write the list of its graspable objects."""
    specs = graspbox.object_sets.load(objects)
    with Run(out, {"poses": ENOUGH, "plans": MOST_PLANS}) as run, Progress(console=console) as progress:
        tried = run.rows("objects")
        known = {row["name"] for row in tried}
        missing = [spec for spec in specs if spec.name not in known]
        for spec in progress.track(missing, description="objects"):
            tried.append(sweep(spec, progress))
    names = set(specs.names)
    rows = sorted((row for row in tried if row["name"] in names), key=lambda row: str(row["name"]))
    write_list(list_file, rows)
    unclear = [row for row in rows if row["graspable"] is None or (row["graspable"] is False and not row["reasons"])]
    for row in unclear:
        console.print(f"{row['name']}: undecided after {row['failed']} failed poses")
    raise typer.Exit(1 if unclear else 0)


if __name__ == "__main__":
    run_program(partial(typer.run, main))
