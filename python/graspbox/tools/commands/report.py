"""``graspbox report``: one HTML file about runs."""

from pathlib import Path
from typing import Annotated

import typer

from graspbox.cli.common import Json, print_json, progress
from graspbox.tools.reports import MAX_PICTURES, MAX_TABLE
from graspbox.tools.reports import report as write


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="JSON of `graspbox evaluate` or `grasp`; folder of a data set, a training or "
            "scripts/evaluate_policies.py.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="The HTML file.")],
    pictures: Annotated[
        int, typer.Option(min=0, max=MAX_PICTURES, help="Most pictures of failures; trials run again.")
    ] = 12,
    trials: Annotated[
        int, typer.Option(min=0, max=MAX_TABLE, help="Most trials in the table; rates count all.")
    ] = 20_000,
    title: Annotated[str, typer.Option(help="Title of the page; by default the names of the runs.")] = "",
    as_json: Json = False,
) -> None:
    """Write a report about evaluations, trials of grasps, data sets and trainings: one HTML file without network.

    Several runs are compared on the trials that they have in common.
    """
    with progress() as bar:
        task = bar.add_task("pictures", total=None)
        made = write(
            runs,
            out,
            pictures=pictures,
            trials=trials,
            title=title,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    size = made.stat().st_size
    if as_json:
        print_json({"file": str(made), "bytes": size})
    else:
        typer.echo(f"{made}: {size / 1e6:.1f} MB")
