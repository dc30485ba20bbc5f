"""The command line: ``graspbox --help``."""

from typing import Annotated

import typer

import graspbox

app = typer.Typer(no_args_is_help=True, add_completion=False, help="From a mesh to simulated grasps.")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"graspbox {graspbox.__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass
