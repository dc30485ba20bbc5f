"""``graspbox demo``: from meshes to simulated grasps for a few objects, with a table and pictures."""

from pathlib import Path
from typing import Annotated

import typer

from graspbox import Scene, object_sets, plan
from graspbox._common.files import check_output, dumps, write_text
from graspbox.cli.common import Json, Seed, Threads, console, end_with, print_json, print_table
from graspbox.cli.grasp import run, summary, table_rows
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.study import comparison

#: Procedural families: round, with a handle, hollow, with spout and arch.
_PROCEDURAL = ("bottle", "mug", "bowl", "kettle")
#: The object whose trials are shown in stages.
_TRACED = "ycb:006_mustard_bottle"
#: Number of best poses that are searched for a firm and a failed grasp.
_TRACED_POSES = 12
_SWEPT = ("procedural:kettle:3", "ycb:019_pitcher_base")


def demo_objects() -> list[str]:
    """Names of the demo's objects; those of YCB only where the extra ``ycb`` is installed."""
    names = [f"procedural:{family}:0" for family in _PROCEDURAL]
    try:
        object_sets.load("ycb")
    except MissingExtraError as error:
        console.print(f"without YCB objects: {error}")
        return names
    return [*names, _TRACED, *comparison.study_objects()]


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the table and the pictures.")] = Path("out/demo"),
    poses: Annotated[int, typer.Option("--poses", min=1, help="Poses to try for each object.")] = 5,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Grasp a few objects, among them those of the reference study, and write tables and pictures into a folder."""
    # matplotlib is slow to import, and no other command needs it.
    from graspbox import pictures

    check_output(out / "grasps.json")
    found = object_sets.load(demo_objects())
    result = run(found, poses=poses, seed=seed, trial=TrialConfig(legacy=True), num_threads=threads)
    table = result.table()
    write_text(out / "grasps.json", dumps(table) + "\n")
    write_text(out / "grasps.md", markdown(table_rows(table)) + f"\n{summary(table)}\n")
    for spec, done in zip(found, result.objects, strict=True):
        if done.plan is not None and done.outcomes is not None:
            example = pictures.GraspExample.of(Scene(spec.load()), done.plan, done.outcomes)
            pictures.save_plan(
                out / f"{spec.name}.png", example.mesh, example.plan, example.outcomes, trial=example.trial
            )
    known = _TRACED.partition(":")[2] in found.names
    compared = comparison.Comparison.of(result)
    if known:
        write_text(out / "table_3_1.md", compared.markdown())
        comparison.save_comparison(out / "table_3_1.png", compared)
    plot_sweeps_and_trials(out, seed, ycb=known)
    if as_json:
        print_json(table)
    else:
        head, *rows = table_rows(table)
        print_table(f"{poses} poses each, seed {seed}", head, rows)
        typer.echo(summary(table))
        if known:
            print_table("table 3.1 of the study, and graspbox", comparison.COLUMNS, compared.rows())
            typer.echo(comparison.CUP_GUESS)
        typer.echo(f"tables and pictures are in {out}")
    end_with(table["refused"])


def plot_sweeps_and_trials(out: Path, seed: int, *, ycb: bool) -> None:
    """Write sweeps of the planner's thresholds, kindness over time, and grasps in stages."""
    from graspbox import pictures

    with console.status("writing pictures"):
        for name in _SWEPT if ycb else _SWEPT[:1]:
            mesh = object_sets.load(name)[0].load()
            pictures.save_sweep(out / f"sweep_{mesh.name}.png", mesh)
        traced = _TRACED if ycb else f"procedural:{_PROCEDURAL[0]}:0"
        scene = Scene(object_sets.load(traced)[0].load())
        planned = plan(scene.mesh, seed=seed, world_from_object=scene.world_from_object).best(_TRACED_POSES)
        try:
            firm, failed = pictures.firm_and_failed(scene, planned)
        except ConfigError as error:
            console.print(f"no picture of a firm and a failed grasp of {scene.name}: {error}")
            return
        pictures.save_kindness(out / "kindness.png", scene.name, failed, firm)
        pictures.save_stages(out / "stages.png", scene, [firm, failed])


def markdown(rows: list[tuple[str, ...]]) -> str:
    """Write a table, whose first row is its head, as Markdown."""
    head, *rest = rows
    lines = [head, ("---",) + ("--:",) * (len(head) - 1), *rest]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)
