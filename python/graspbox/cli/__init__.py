"""The command line: ``graspbox --help``. Each command has its own module.

Exit status: 0 if the command did its work, 1 if it could not (or could not for some of the objects), 2 for a wrong
call, 130 after Ctrl-C, 141 if a reader such as ``head`` closed the output.
"""

from typing import Annotated, NoReturn

import typer

import graspbox
from graspbox.cli import (
    bench,
    dataset,
    demo,
    evaluate,
    grasp,
    grasp_image,
    hand,
    objects,
    plan,
    record,
    report,
    train,
    view,
    voxelize,
)
from graspbox.cli.benchmarks.clutter import benchmark_app
from graspbox.cli.exports.grasps import export_grasps
from graspbox.cli.exports.scenes import export_scene
from graspbox.cli.serving import environments, mcp, policies
from graspbox.programs import run_program

typer_app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
typer_app.command("objects")(objects.objects)
typer_app.command("prepare")(objects.prepare)
typer_app.command("scenes")(objects.scenes)
typer_app.command("plan")(plan.plan)
typer_app.command("view")(view.view)
typer_app.command("voxelize")(voxelize.voxelize)
typer_app.command("grasp")(grasp.grasp)
typer_app.command("grasp-image")(grasp_image.grasp_image_command)
typer_app.add_typer(hand.hand_app, name="hand")
typer_app.command("export-scene")(export_scene)
typer_app.command("dataset")(dataset.dataset)
typer_app.command("record")(record.record)
typer_app.command("export")(record.export)
typer_app.command("export-grasps")(export_grasps)
typer_app.add_typer(train.train_app, name="train")
typer_app.command("evaluate")(evaluate.evaluate)
typer_app.add_typer(benchmark_app, name="benchmark")
typer_app.command("report")(report.report)
typer_app.command("serve")(environments.serve)
typer_app.command("serve-policy")(policies.serve_policy)
typer_app.command("mcp")(mcp.mcp)
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


def app() -> NoReturn:
    """Run the command line; errors that graspbox raises on purpose become one line and an exit status."""
    run_program(typer_app)
