"""Options, tables and progress bars that the commands share."""

import shlex
import sys
import warnings
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from graspbox import _core, object_sets, policies
from graspbox._common.files import check_output, dumps, write_text
from graspbox._common.rotations import upright_pose
from graspbox.errors import ObjectSetError
from graspbox.hands import Hand, load_hand
from graspbox.hands.loading import AssumedWarning, hand_like, told
from graspbox.object_sets.mesh_folders import MASSES

Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on standard output.")]
Seed = Annotated[int, typer.Option(min=0, max=2**64 - 1, help="Seed of all random numbers.")]
PolicyName = Annotated[
    str,
    typer.Argument(
        help=f"Policy: {', '.join(policies.names())}, an installed one such as depth, or the folder of a trained one, "
        "or of a run of `graspbox train sb3`."
    ),
]
Threads = Annotated[
    int | None, typer.Option(min=1, max=1024, help="Threads to use; all by default. Results do not depend on it.")
]
Rehearse = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=256,
        metavar="GRASPS",
        help="How many of the best grasps are tried in simulation on the completed shape before one is chosen, such as "
        "8; 0: none. By default as in the policy's folder.",
    ),
]
Objects = Annotated[list[str] | None, typer.Option(help="Object set, 'procedural' by default; may be repeated.")]
ObjectsOfPolicy = Annotated[
    list[str] | None,
    typer.Option(help="Object set; may be repeated. By default 'procedural', or the held-out ones of a run."),
]
Split = Annotated[object_sets.Split | None, typer.Option(help="Use only this split.")]
HandName = Annotated[
    str, typer.Option(help="A hand by its name, or its two files with a comma between: hand.urdf,hand.toml.")
]
HandOfPolicy = Annotated[
    str | None, typer.Option(help="The hand, by its name or as hand.urdf,hand.toml; by default that of the policy.")
]
PerScene = Annotated[int | None, typer.Option(min=1, max=40, help="Number of objects of a layout; 5 by default.")]
Spread = Annotated[
    float, typer.Option(help="Distance of the objects from the middle, 0.25 to 2 times that of VGN; below 1: closer.")
]
Scale = Annotated[float, typer.Option(help="Metres per unit of the mesh files.")]
Mass = Annotated[float | None, typer.Option(help="Kilograms of the object, where there is only one.")]

#: Progress and remarks go to standard error; standard output holds results only.
console = Console(stderr=True, markup=False, highlight=False, emoji=False)


def standing(base: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Return the pose (4, 4) of the upright base of an arm: x, y, z in metres, and degrees about z."""
    return upright_pose(base[:3], float(np.radians(base[3])))


def progress() -> Progress:
    """Make a progress bar on standard error; it disappears at the end."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


def check_files(out: Path | None, picture: Path | None = None) -> None:
    """Refuse files that cannot be written before anything is computed."""
    if out is not None:
        check_output(out)
    if picture is not None:
        from graspbox.pictures.files import check_path  # imports matplotlib

        if not picture.is_dir():
            check_output(picture)
        check_path(picture)


def write_json(path: Path, value: Any) -> None:
    """Write a result as JSON into a file."""
    write_text(path, dumps(value) + "\n")
    console.print(f"wrote {path}")


def print_json(value: Any) -> None:
    """Print a result as JSON on standard output."""
    sys.stdout.write(dumps(value) + "\n")


def print_table(title: str, columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Print a table on standard output; all but the first column are aligned right."""
    table = Table(title=title, title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    Console(file=sys.stdout, markup=False, highlight=False, emoji=False).print(table)


def made(**facts: Any) -> dict[str, Any]:
    """Describe how a result was made: the command, the version of graspbox, the date, and other facts."""
    words = ["graspbox" if Path(sys.argv[0]).stem in ("graspbox", "__main__") else sys.argv[0], *sys.argv[1:]]
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return {"command": shlex.join(words), "graspbox": _core.__version__, "date": date, **facts}


def find(
    objects: list[str] | None, split: object_sets.Split | None, scale: float, mass: float | None = None
) -> object_sets.ObjectSet:
    """Load the object sets that the command line names, by default ``procedural``; refuse a mass of several objects."""
    selected = object_sets.load(objects or ["procedural"], split=split, scale=scale, mass=mass)
    if mass is not None and len(selected) != 1:
        raise ObjectSetError(
            f"--mass is the mass of one object, and {selected.name!r} has {len(selected)}; write their masses into a "
            f"table {MASSES} in their folder"
        )
    return selected


def end_with(refused: Mapping[str, str]) -> None:
    """Print the objects that could not be used on standard error, and end with exit status 1 if there are any."""
    for name, why in refused.items():
        console.print(f"{name}: {why}", style="red", soft_wrap=True)
    if refused:
        raise typer.Exit(1)


def find_hand(name: str) -> Hand:
    """Load the hand that the command line names, by its name or its two files; print what its URDF does not state."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        hand = load_hand(hand_like(name))
    for warning in caught:
        if isinstance(warning.message, AssumedWarning):
            text = told(warning.message.assumed, "are listed by `graspbox hand check`")
        elif issubclass(warning.category, UserWarning):
            text = str(warning.message)
        else:  # such as a deprecation in another package, which is not about the hand
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
            continue
        console.print(f"warning: {text}", style="yellow", soft_wrap=True)
    return hand


def find_one(mesh: str, scale: float) -> object_sets.ObjectSpec:
    """Return the object that the command line names; refuse several."""
    selected = find([mesh], None, scale)
    if len(selected) != 1:
        raise ObjectSetError(f"{mesh!r} names {len(selected)} objects; name one")
    return selected[0]
