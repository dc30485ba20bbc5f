"""``graspbox mcp``: tools for agents, over the Model Context Protocol."""

from pathlib import Path
from typing import Annotated

import typer

from graspbox.cli.common import Threads
from graspbox.hands import Hand
from graspbox.tools.commands.serve import Log, log_to_stderr
from graspbox.tools.mcp import ToolServer, ToolSettings
from graspbox.tools.remote.serving import available


def mcp(
    folder: Annotated[Path, typer.Option(help="Folder whose mesh files and depth images agents may name.")] = Path(),
    objects: Annotated[
        list[str] | None,
        typer.Option(
            help="Object set that agents may name, with its parts; NAME=SET offers it under another name, which a "
            "path needs. Repeatable; by default procedural and ycb, as far as they are installed."
        ),
    ] = None,
    hands: Annotated[
        list[str] | None, typer.Option(help="Hand that agents may name; repeatable; by default all.")
    ] = None,
    policy: Annotated[
        str | None, typer.Option(help="Folder of a published policy, or hf://owner/name, for the tool grasp_image.")
    ] = None,
    time_limit: Annotated[
        float, typer.Option(min=1.0, max=3600.0, help="Seconds after which a call is ended.")
    ] = ToolSettings.time_limit,
    threads: Threads = None,
    log: Log = "text",
) -> None:
    """Serve tools for agents over standard input and output: plan, simulate, look, grasp_image.

    Agents can only name files of the folder, and the tools write no results. A program that runs agents starts this
    command itself; it ends when that program closes its input.
    """
    settings = ToolSettings(
        folder=folder,
        objects=tuple(objects or available()),
        hands=tuple(hands or Hand.names()),
        policy=policy,
        time_limit=time_limit,
        threads=threads,
    )
    server = ToolServer(settings)
    log_to_stderr(log)
    server.run()
