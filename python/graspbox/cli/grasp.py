"""``graspbox grasp``: plan and try grasps over an object set."""

from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox._common.arguments import plain
from graspbox.cli import common
from graspbox.cli.recorders import Rerun, RerunEpisodes, rerun_recorder
from graspbox.configs import ShakeConfig, TrialConfig
from graspbox.evaluation.planner_trials import SetResult, try_set
from graspbox.object_sets import ObjectSet


def run(objects: ObjectSet, **settings: Any) -> SetResult:
    """Evaluate a set with a progress bar."""
    with common.progress() as bar:
        task = bar.add_task("grasping", total=len(objects))
        return try_set(objects, done=lambda _: bar.advance(task), **settings)


#: Columns of the table, and the key of each in a row. The shake's is left out where nothing was shaken.
COLUMNS = {
    "tried": "tried",
    "succeeded": "succeeded",
    "secure": "secure",
    "shake": "survived_shake",
    "legacy": "legacy_succeeded",
    "first": "first_succeeded",
}


def table_rows(table: dict[str, Any]) -> list[tuple[str, ...]]:
    """Lay the table out for reading: its head, a row per object, and the sums."""
    shaken = any(row["survived_shake"] is not None for row in table["objects"])
    columns = {name: key for name, key in COLUMNS.items() if shaken or key != "survived_shake"}
    keys = tuple(columns.values())

    words = {"True": "yes", "False": "no", "None": "-"}
    rows = [(row["name"], *(words.get(str(row[k]), str(row[k])) for k in keys)) for row in table["objects"]]
    sums = [str(sum(row[k] or 0 for row in table["objects"])) for k in keys]
    return [("object", *columns), *rows, ("total", *sums)]


def summary(table: dict[str, Any]) -> str:
    """Sum the table up in a line."""
    survived = [row["survived_shake"] for row in table["objects"] if row["survived_shake"] is not None]
    shaken = f"{sum(survived)} survive the shake; " if survived else ""
    return (
        f"{table['succeeded']} of {table['tried']} poses succeed ({table['rate']:.1%}); "
        f"{table['objects_with_success']} of {len(table['objects'])} objects have a success; "
        f"first-ranked pose {table['first_rate']:.1%}; {shaken}{table['trials_per_s']:.1f} trials/s"
    )


def grasp(
    objects: common.Objects = None,
    poses: Annotated[int, typer.Option(min=1, help="Poses to try for each object, best first.")] = 20,
    legacy: Annotated[
        bool, typer.Option(help="Also record the reference study's measures (failed grasps then run for 2.5 s).")
    ] = True,
    shake: Annotated[
        bool,
        typer.Option(
            "--shake", help="Shake every success on six axes with 2 g; the table counts the objects still held."
        ),
    ] = False,
    hand: common.HandName = "reflex",
    split: common.Split = None,
    scale: common.Scale = 1.0,
    mass: common.Mass = None,
    seed: common.Seed = 0,
    threads: common.Threads = None,
    out: Annotated[
        Path | None, typer.Option(help="Write the JSON, with every grasp and its outcome, into this file.")
    ] = None,
    details: Annotated[
        bool, typer.Option("--details", help="Print every grasp and its outcome too, with --json.")
    ] = False,
    rerun: Rerun = None,
    rerun_episodes: RerunEpisodes = 10,
    as_json: common.Json = False,
) -> None:
    """Plan grasps for every object of a set and try the best ones in simulation.

    The exit status is 1 if some objects cannot be used.
    """
    if details and not as_json:
        raise typer.BadParameter("it needs --json; --out always writes the details", param_hint="--details")
    common.check_files(out)
    recorder = rerun_recorder(rerun)
    object_set, loaded = common.find(objects, split, scale, mass), common.find_hand(hand)
    trial = TrialConfig(legacy=legacy, shake=ShakeConfig() if shake else None)
    result = run(object_set, hand=loaded, poses=poses, seed=seed, trial=trial, num_threads=threads)
    table = result.table()
    facts = {"seed": seed, "hand": hand, "trial": plain(trial, "trial")}
    content = {**result.table(details=True), "made": common.made(**facts)} if details or out is not None else {}
    if as_json:
        common.print_json(content if details else table)
    else:
        head, *rows = table_rows(table)
        common.print_table(f"{object_set.name}: {poses} poses each, seed {seed}", head, rows)
        typer.echo(summary(table))
    if out is not None:
        common.write_json(out, content)
    if recorder is not None:
        recorder.write_grasps(result, loaded, trial, rerun_episodes)
    common.end_with(table["refused"])
