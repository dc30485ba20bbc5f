"""Find the YCB objects that the hand can grasp at all; writes the list behind the object set ``ycb:graspable``.

An object is tried in ranking order, plan after plan with another seed, until a pose succeeds. It leaves the list only
after 2,000 poses without a success. The log (JSON lines) lets an interrupted sweep go on where it was.

    python scripts/sweep_graspable.py --log out/graspable.jsonl --list python/graspbox/data/ycb_graspable.txt
"""

import json
import os
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import track

import graspbox
from graspbox.object_sets import ObjectSpec

#: Poses without a success after which an object counts as not graspable.
ENOUGH = 2000
#: Poses a call: small enough to stop soon after the first success.
BATCH = 40
#: Plans a sweep: an object that offers few poses would otherwise never have been tried often enough.
MOST_PLANS = 400


def sweep(spec: ObjectSpec) -> dict[str, object]:
    """Try poses of one object until one succeeds or enough have failed."""
    scene = graspbox.Scene(spec.load())
    tried, failures = 0, {}
    for seed in range(MOST_PLANS):
        plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=seed).best()
        for start in range(0, len(plan), BATCH):
            part = slice(start, start + BATCH)
            out = scene.simulate(plan.poses[part], plan.preshape[part])
            if out.success.any():
                return {"name": spec.name, "graspable": True, "tried": tried + int(out.success.argmax()) + 1}
            tried += len(out)
            for kind in out.failure:
                failures[str(kind)] = failures.get(str(kind), 0) + 1
            if tried >= ENOUGH:
                return {"name": spec.name, "graspable": False, "tried": tried, "failures": failures}
    return {"name": spec.name, "graspable": None, "tried": tried, "failures": failures}


def main(
    log: Annotated[Path, typer.Option(help="JSON lines, one an object; what it holds is not swept again.")],
    list_file: Annotated[Path, typer.Option("--list", help="Where to write the names of the graspable objects.")],
    objects: Annotated[str, typer.Option(help="The object set to sweep.")] = "ycb",
) -> None:
    """Sweep a set and write the list of its graspable objects."""
    log.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.is_file() else []
    known = {row["name"] for row in rows}
    specs = [spec for spec in graspbox.object_sets.load(objects) if spec.name not in known]
    for spec in track(specs, description="sweeping"):
        rows.append(sweep(spec))
        with log.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
            os.fsync(file.fileno())
    rows.sort(key=lambda row: row["name"])
    lines = ["# YCB objects that the ReFlex hand can grasp; made by scripts/sweep_graspable.py.", "# Left out:"]
    out = [row for row in rows if row["graspable"] is False]
    lines += [f"# {row['name']}: {row['tried']} poses, {json.dumps(row['failures'])}" for row in out] or ["# none"]
    lines += [row["name"] for row in rows if row["graspable"] is not False]
    temporary = list_file.with_suffix(".tmp")
    temporary.write_text("\n".join(lines) + "\n")
    temporary.replace(list_file)


if __name__ == "__main__":
    typer.run(main)
