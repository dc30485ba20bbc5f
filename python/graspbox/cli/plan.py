"""``graspbox plan``: boxes around an object, and hand poses from them."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer

import graspbox
from graspbox._common.files import check_output
from graspbox.cli import common
from graspbox.planning import Box, Plan
from graspbox.planning.plan_files import grasp_rows


def box_row(box: Box) -> dict[str, object]:
    """Write a box as JSON."""
    return {
        "center": box.center.tolist(),
        "axes": box.axes.tolist(),
        "half_extents": box.half_extents.tolist(),
        "volume": box.volume,
    }


def plan_table(planned: Plan, seconds: float) -> dict[str, Any]:
    """Write a plan as ``graspbox plan --json`` prints it."""
    return {
        "name": planned.name,
        "hand": planned.hand_name,
        "world_from_object": planned.world_from_object.tolist(),
        "boxes": [box_row(box) for box in planned.tree],
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
        str, typer.Option(help="Boxes of least volume ('minimum') or along principal axes ('pca').")
    ] = "minimum",
    max_boxes: Annotated[int, typer.Option(min=1, help="Maximum number of boxes.")] = 8,
    settle: Annotated[
        bool, typer.Option(help="Let the object settle first; otherwise plan for the pose in its file.")
    ] = True,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of boxes and best poses into this file.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Save the plan here, for graspbox.Plan.load.")] = None,
    hand: common.HandName = "reflex",
    seed: common.Seed = 0,
    scale: common.Scale = 1.0,
    threads: common.Threads = None,
    as_json: common.Json = False,
) -> None:
    """Cut an object into boxes, propose hand poses, and drop those that collide."""
    if out is not None:
        check_output(out)
    if picture is not None:
        from graspbox import pictures

        if not picture.is_dir():
            check_output(picture)
        picture = pictures.check_path(picture)
    spec, with_hand = common.find_one(mesh, scale), common.find_hand(hand)
    decompose = graspbox.DecomposeConfig(fit=fit, max_boxes=max_boxes)  # type: ignore[arg-type]
    with common.console.status("planning"):
        loaded = spec.load()
        rest = graspbox.Scene(loaded, hand=with_hand).world_from_object if settle else None
        started = time.perf_counter()
        planned = graspbox.plan(
            loaded, hand=with_hand, seed=seed, world_from_object=rest, decompose=decompose, num_threads=threads
        )
        table = plan_table(planned, time.perf_counter() - started)
    if as_json:
        common.print_json(table)
    else:
        print_plan(table)
    if out is not None:
        planned.save(out)
        common.console.print(f"wrote {out}")
    if picture is not None:
        pictures.save_plan(picture, loaded, planned, hand=with_hand)
        common.console.print(f"wrote {picture}")
