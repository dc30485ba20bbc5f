"""``graspbox export``: recorded demonstrations in other formats."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from graspbox.data import episodes as demonstrations
from graspbox.tools.demonstrations import to_lerobot, to_minari


def export(
    folder: Annotated[Path, typer.Argument(help="Folder written by `graspbox record`.")],
    form: Annotated[Literal["minari", "lerobot"], typer.Option("--format", help="The format.")],
    out: Annotated[str, typer.Option(help="Folder of the LeRobotDataset, or id of the Minari data set.")],
) -> None:
    """Write recorded demonstrations in the format of Minari or LeRobot."""
    made = demonstrations.Demonstrations(folder)
    where = to_minari(made, out).spec.data_path if form == "minari" else to_lerobot(made, out)
    typer.echo(f"{len(made.episodes)} episodes: {where}")
