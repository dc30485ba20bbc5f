"""``graspbox plan``: boxes around an object, and hand poses from them."""

import time
from pathlib import Path
from typing import Annotated

import typer

import graspbox
from graspbox.cli.common import Json, Scale, Seed, console, find, print_json, print_table
from graspbox.errors import ObjectSetError
from graspbox.planning import Box


def box_row(box: Box) -> dict[str, object]:
    """Write a box as JSON."""
    return {
        "center": box.center.tolist(),
        "axes": box.axes.tolist(),
        "half_extents": box.half_extents.tolist(),
        "volume": box.volume,
    }


def plan(
    mesh: Annotated[str, typer.Argument(help="A mesh file, or an object set that names one object.")],
    fit: Annotated[
        str, typer.Option(help="Boxes of least volume ('minimum') or along principal axes ('pca').")
    ] = "minimum",
    max_boxes: Annotated[int, typer.Option(min=1, help="Greatest number of boxes.")] = 8,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of boxes and best poses into this file.")
    ] = None,
    seed: Seed = 0,
    scale: Scale = 1.0,
    as_json: Json = False,
) -> None:
    """Cut an object into boxes, propose hand poses, and drop those that collide."""
    found = find([mesh], None, scale)
    if picture is not None:
        from graspbox import pictures

        picture = pictures.check_path(picture)
    if len(found) != 1:
        raise ObjectSetError(f"{mesh!r} names {len(found)} objects; name one")
    loaded = found[0].load()
    decompose = graspbox.DecomposeConfig(fit=fit, max_boxes=max_boxes)  # type: ignore[arg-type]
    with console.status("planning"):
        started = time.perf_counter()
        planned = graspbox.plan(loaded, seed=seed, decompose=decompose)
        seconds = time.perf_counter() - started
    if picture is not None:
        pictures.save_plan(picture, loaded, planned)
        console.print(f"wrote {picture}")
    boxes = [box_row(box) for box in planned.tree]
    feasible = int(planned.feasible.sum())
    if as_json:
        print_json({"boxes": boxes, "poses": len(planned), "feasible": feasible, "seconds": seconds})
        return
    rows = [
        (str(i), *(f"{2000 * h:.1f}" for h in box.half_extents), f"{box.volume * 1e6:.2f}")
        for i, box in enumerate(planned.tree)
    ]
    print_table(
        f"{loaded.name}: {len(rows)} boxes", ("box", "long / mm", "middle / mm", "short / mm", "volume / cm3"), rows
    )
    typer.echo(f"{len(planned)} poses, {feasible} feasible, {seconds:.2f} s")
