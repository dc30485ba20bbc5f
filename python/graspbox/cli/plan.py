"""``graspbox plan``: boxes around an object, and hand poses from them."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import graspbox
from graspbox.cli import common
from graspbox.planning import Plan
from graspbox.planning.plan_files import grasp_rows


def plan_table(planned: Plan, seconds: float) -> dict[str, Any]:
    """Return a plan as ``graspbox plan --json`` prints it."""
    arrays = ("center", "axes", "half_extents")
    return {
        "name": planned.name,
        "hand": planned.hand_name,
        "world_from_object": planned.world_from_object.tolist(),
        "boxes": [
            {**{name: getattr(box, name).tolist() for name in arrays}, "volume": box.volume} for box in planned.tree
        ],
        "poses": len(planned),
        "feasible": int(planned.feasible.sum()),
        "seconds": seconds,
        "grasps": grasp_rows(planned),
    }


def print_plan(table: dict[str, Any]) -> None:
    """Print the boxes as a table, and count the poses."""
    rows = [
        (str(i), *(f"{2000 * h:.1f}" for h in box["half_extents"]), f"{box['volume'] * 1e6:.2f}")
        for i, box in enumerate(table["boxes"])
    ]
    boxes = "1 box" if len(rows) == 1 else f"{len(rows)} boxes"
    columns = ("box", "long / mm", "middle / mm", "short / mm", "volume / cm3")
    common.print_table(f"{table['name']}: {boxes}", columns, rows)
    typer.echo(f"{table['poses']} poses, {table['feasible']} feasible, {table['seconds']:.2f} s")


def plan(
    mesh: Annotated[str, typer.Argument(help="A mesh file, or an object set that names one object.")],
    fit: Annotated[
        Literal["minimum", "pca"], typer.Option(help="Boxes of least volume or along principal axes.")
    ] = "minimum",
    max_boxes: Annotated[int, typer.Option(min=1, help="Maximum number of boxes.")] = 8,
    settle: Annotated[
        bool, typer.Option(help="Let the object settle first; otherwise plan for the pose in its file.")
    ] = True,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of boxes and best poses into this file.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Save the plan here, for graspbox.Plan.load.")] = None,
    hand: common.HandName = "reflex",
    seed: common.Seed = 0,
    scale: common.Scale = 1.0,
    threads: common.Threads = None,
    as_json: common.Json = False,
) -> None:
    """Cut an object into boxes, propose hand poses, and drop those that collide."""
    common.check_files(out, picture)
    spec, with_hand = common.find_one(mesh, scale), common.find_hand(hand)
    decompose = graspbox.DecomposeConfig(fit=fit, max_boxes=max_boxes)
    with common.console.status("planning"):
        loaded = spec.load()
        rest = graspbox.Scene(loaded, hand=with_hand).world_from_object if settle else None
        started = time.perf_counter()
        planned = graspbox.plan(
            loaded, hand=with_hand, seed=seed, world_from_object=rest, decompose=decompose, num_threads=threads
        )
        planned = replace(planned, source=spec.source, scale=spec.scale, mass=spec.mass)
        table = plan_table(planned, time.perf_counter() - started)
    if as_json:
        common.print_json(table)
    else:
        print_plan(table)
    if out is not None:
        planned.save(out)
        common.console.print(f"wrote {out}")
    if picture is not None:
        from graspbox import pictures

        pictures.save_plan(picture, loaded, planned, hand=with_hand)
        common.console.print(f"wrote {picture}")
