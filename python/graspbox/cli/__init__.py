"""The command line: ``graspbox --help``. Each command has a module of its own.

Exit status: 0 if the command did its work, 1 if it could not (or could not for some of the objects), 2 for a wrong
call, 130 after Ctrl-C.
"""

import errno
import io
import os
import sys
from typing import Annotated

import typer

import graspbox
from graspbox.cli import (
    bench,
    dataset,
    demo,
    evaluate,
    grasp,
    grasp_image,
    objects,
    plan,
    prepare,
    record,
    serve,
    serve_policy,
    voxelize,
)
from graspbox.errors import ConfigError, GraspboxError, InternalError, MissingExtraError, ObjectSetError

typer_app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
typer_app.command("objects")(objects.objects)
typer_app.command("prepare")(prepare.prepare)
typer_app.command("plan")(plan.plan)
typer_app.command("voxelize")(voxelize.voxelize)
typer_app.command("grasp")(grasp.grasp)
typer_app.command("grasp-image")(grasp_image.grasp_image_command)
typer_app.command("dataset")(dataset.dataset)
typer_app.command("record")(record.record)
typer_app.command("export")(record.export)
typer_app.command("evaluate")(evaluate.evaluate)
typer_app.command("serve")(serve.serve)
typer_app.command("serve-policy")(serve_policy.serve_policy)
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
    for stream in (sys.stdout, sys.stderr):
        # Names of files need not be text in the encoding of the terminal.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    raise SystemExit(_status())


def _status() -> int:
    """Run the command; its exit status."""
    try:
        try:
            typer_app()
            code: object = 0
        except SystemExit as ended:
            code = ended.code
        sys.stdout.flush()
        return code if isinstance(code, int) else 0 if code is None else 1
    except InternalError:
        raise
    except GraspboxError as error:
        _complain(str(error))
        return 2 if isinstance(error, ConfigError | ObjectSetError | MissingExtraError) else 1
    except KeyboardInterrupt:
        return 130
    except MemoryError:
        _complain("there is not enough memory")
        return 1
    except OSError as error:
        if error.filename is not None:
            _complain(f"{error.strerror}: {error.filename}")
            return 1
        _close_output()
        if error.errno != errno.EPIPE:
            _complain(f"the output cannot be written: {error.strerror}")
        return 1


def _complain(sentence: str) -> None:
    print(f"graspbox: {sentence}", file=sys.stderr)


def _close_output() -> None:
    """Drop what is still to be printed, which Python would try again when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
