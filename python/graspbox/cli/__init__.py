"""The command line: ``graspbox --help``. Each command has a module of its own.

Exit status: 0 if the command did what it says, 1 if it could not (or could not for some of the objects), 2 for a
wrong call.
"""

import sys
from typing import Annotated

import typer

import graspbox
from graspbox.cli import bench, demo, evaluate, grasp, objects, plan, voxelize
from graspbox.errors import ConfigError, GraspboxError, InternalError, MissingExtraError, ObjectSetError

typer_app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
typer_app.command("objects")(objects.objects)
typer_app.command("plan")(plan.plan)
typer_app.command("voxelize")(voxelize.voxelize)
typer_app.command("grasp")(grasp.grasp)
typer_app.command("evaluate")(evaluate.evaluate)
typer_app.command("demo")(demo.demo)
typer_app.command("bench")(bench.bench)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"graspbox {graspbox.__version__}")
        raise typer.Exit


@typer_app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """From a mesh to simulated grasps."""


def app() -> None:
    """Run the command line; errors that graspbox raises on purpose become one line and an exit status."""
    try:
        typer_app()
    except InternalError:
        raise
    except GraspboxError as error:
        print(f"graspbox: {error}", file=sys.stderr)
        wrong_call = isinstance(error, ConfigError | ObjectSetError | MissingExtraError)
        raise SystemExit(2 if wrong_call else 1) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
