"""``graspbox demo``: from meshes to simulated grasps for a few objects, with a table and pictures."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from graspbox import Outcomes, Plan, Scene, object_sets, plan
from graspbox._common.files import check_output, dumps, write_text
from graspbox.cli.common import Json, Seed, Threads, console, end_with, print_json, print_table, progress
from graspbox.cli.grasp import run, summary, table_rows
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.evaluation.planner_trials import SetResult

#: Procedural families: round, with a handle, hollow, with spout and arch.
_PROCEDURAL = ("bottle", "mug", "bowl", "kettle")
#: The object whose trials are shown in stages.
_TRACED = "006_mustard_bottle"
#: Objects of the YCB set; after the first one those that a study of 2017 grasped.
_YCB = (
    _TRACED,
    "021_bleach_cleanser",
    "059_chain",
    "007_tuna_fish_can",
    "065-i_cups",
    "035_power_drill",
    "037_scissors",
    "070-b_colored_wood_blocks",
    "030_fork",
    "013_apple",
    "065-g_cups",
)
#: Number of best poses that are searched for a firm and a failed grasp.
_TRACED_POSES = 12
#: Objects whose boxes are shown under several thresholds.
_SWEPT = ("procedural:kettle:3", "ycb:019_pitcher_base")


def demo_objects() -> list[str]:
    """Names of the demo's objects; those of YCB only where the extra ``ycb`` is installed."""
    names = [f"procedural:{family}:0" for family in _PROCEDURAL]
    try:
        object_sets.load("ycb")
    except MissingExtraError as error:
        console.print(f"without YCB objects: {error}")
        return names
    return [*names, *(f"ycb:{name}" for name in _YCB)]


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the table and the pictures.")] = Path("out/demo"),
    poses: Annotated[int, typer.Option(min=1, help="Poses to try for each object.")] = 5,
    seed: Seed = 0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Grasp a few objects and write a table and pictures into a folder."""
    check_output(out / "grasps.json")
    object_set = object_sets.load(demo_objects())
    result = run(object_set, poses=poses, seed=seed, trial=TrialConfig(legacy=True), num_threads=threads)
    table = result.table()
    write_text(out / "grasps.json", dumps(table) + "\n")
    write_text(out / "grasps.md", markdown(table_rows(table)) + f"\n{summary(table)}\n")
    write_pictures(out, [*_plans(out, object_set, result), *_sweeps(out, object_set), *_stages(out, object_set, seed)])
    if as_json:
        print_json(table)
    else:
        head, *rows = table_rows(table)
        print_table(f"{poses} poses each, seed {seed}", head, rows)
        typer.echo(summary(table))
        typer.echo(f"tables and pictures are in {out}")
    end_with(table["refused"])


def write_pictures(out: Path, pictures: Sequence[tuple[str, Callable[[], object]]]) -> None:
    """Write pictures, each a name and a function, and print their names."""
    with progress() as bar:
        task = bar.add_task("pictures", total=len(pictures))
        for number, (name, write) in enumerate(pictures):
            bar.update(task, description=f"writing {out / name}")
            if not console.is_terminal:
                console.print(f"writing {out / name} ({number + 1} of {len(pictures)})", soft_wrap=True)
            write()
            bar.advance(task)


def _plans(
    out: Path, object_set: object_sets.ObjectSet, result: SetResult
) -> Iterator[tuple[str, Callable[[], object]]]:
    """Picture every object with its boxes, best poses and a trial."""
    from graspbox import pictures

    def write(file: Path, scene: Scene, planned: Plan, outcomes: Outcomes) -> None:
        example = pictures.GraspExample.of(scene, planned, outcomes)
        pictures.save_plan(file, example.mesh, example.plan, example.outcomes, trial=example.trial)

    for spec, done in zip(object_set, result.objects, strict=True):
        if done.plan is not None and done.outcomes is not None:
            scene = Scene(spec.load())
            yield f"{spec.name}.png", partial(write, out / f"{spec.name}.png", scene, done.plan, done.outcomes)


def _sweeps(out: Path, object_set: object_sets.ObjectSet) -> Iterator[tuple[str, Callable[[], object]]]:
    """Picture the boxes under thresholds of the planner."""
    from graspbox import pictures

    for name in _SWEPT if _TRACED in object_set.names else _SWEPT[:1]:
        mesh = object_sets.load(name)[0].load()
        yield f"sweep_{mesh.name}.png", partial(pictures.save_sweep, out / f"sweep_{mesh.name}.png", mesh)


def _stages(out: Path, object_set: object_sets.ObjectSet, seed: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Picture a firm and a failed grasp: in stages, and the kindness over time."""
    from graspbox import pictures

    traced = object_set[object_set.names.index(_TRACED)] if _TRACED in object_set.names else object_set[0]
    scene = Scene(traced.load())
    planned = plan(scene.mesh, seed=seed, world_from_object=scene.world_from_object).best(_TRACED_POSES)
    try:
        firm, failed = pictures.firm_and_failed(scene, planned)
    except ConfigError as error:
        console.print(f"no picture of a firm and a failed grasp of {scene.name}: {error}")
        return
    yield "kindness.png", partial(pictures.save_kindness, out / "kindness.png", scene.name, failed, firm)
    yield "stages.png", partial(pictures.save_stages, out / "stages.png", scene, [firm, failed])


def markdown(rows: list[tuple[str, ...]]) -> str:
    """Write a table, whose first row is its head, as Markdown."""
    head, *rest = rows
    lines = [head, ("---",) + ("--:",) * (len(head) - 1), *rest]
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)
