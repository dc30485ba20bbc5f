"""``graspbox demo``: the whole way on a few objects, with its table and its pictures."""

import json
from pathlib import Path
from typing import Annotated

import typer

from graspbox import object_sets, pictures
from graspbox.cli.common import Json, Seed, Threads, console, print_json, print_table
from graspbox.cli.grasp import COLUMNS, run, summary, table_rows
from graspbox.configs import TrialConfig
from graspbox.errors import MissingExtraError

#: One of each kind: upright, lying, round, hollow, with a handle.
_YCB = ("005_tomato_soup_can", "006_mustard_bottle", "011_banana", "013_apple", "025_mug", "035_power_drill")
_PROCEDURAL = ("box", "can", "bottle", "ball", "mug", "bowl")


def demo_objects() -> list[str]:
    """Name the demo's objects; those of YCB only where the extra ``ycb`` is installed."""
    names = [f"procedural:{family}:0" for family in _PROCEDURAL]
    try:
        object_sets.load("ycb")
    except MissingExtraError as error:
        console.print(f"without YCB objects: {error}", markup=False)
        return names
    return [*names, *(f"ycb:{name}" for name in _YCB)]


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the table and the pictures.")] = Path("out/demo"),
    poses: Annotated[int, typer.Option("--poses", min=1, help="Poses to try for each object.")] = 5,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Grasp a dozen objects; leaves a table and pictures in a folder."""
    out.mkdir(parents=True, exist_ok=True)
    found = object_sets.load(demo_objects())
    result = run(found, poses=poses, seed=seed, trial=TrialConfig(legacy=True), num_threads=threads)
    table = result.table()
    (out / "grasps.json").write_text(json.dumps(table, indent=2, allow_nan=False) + "\n")
    (out / "grasps.md").write_text(markdown(table_rows(table)) + f"\n{summary(table)}\n")
    for spec, done in zip(found, result.objects, strict=True):
        if done.plan is not None:
            pictures.save_plan(out / f"{spec.name}.png", spec.load(), done.plan, done.outcomes)
    if as_json:
        print_json(table)
    else:
        print_table(f"{poses} poses each, seed {seed}", COLUMNS, table_rows(table))
        typer.echo(summary(table))
        typer.echo(f"table and pictures are in {out}")
    if any(r.error for r in result.objects):
        raise typer.Exit(1)


def markdown(rows: list[tuple[str, ...]]) -> str:
    """Write the table as Markdown."""
    lines = [COLUMNS, ("---",) + ("--:",) * (len(COLUMNS) - 1), *rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)
