"""Show arms, map what they reach, plan paths, or begin the files of your own."""

import json
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from graspbox._common.files import check_output, write_text
from graspbox.arms import load_arm
from graspbox.arms.drafting import draft_arm
from graspbox.cli.arm.maps import map_command
from graspbox.cli.arm.path import path_command
from graspbox.cli.common import Json, console, print_json, print_table
from graspbox.errors import ArmError, ConfigError, FileError
from graspbox.hands.loading import hand_like

__all__ = ["arm_app"]

arm_app = typer.Typer(no_args_is_help=True, help=__doc__)
arm_app.command("path")(path_command)
arm_app.command("map")(map_command)


@arm_app.command("show")
def show(
    arm: Annotated[str, typer.Argument(help="A name such as fr3, or URDF,TOML.")],
    as_json: Json = False,
) -> None:
    """Print joints with their limits and home, the payload, and what was assumed of an arm's files."""
    try:
        loaded = load_arm(hand_like(arm))
    except (ArmError, FileError) as error:
        console.print(f"graspbox: {error}", soft_wrap=True)
        raise typer.Exit(2) from None
    columns = {"speed": loaded.speeds, "acceleration": loaded.accelerations, "jerk": loaded.jerks, "home": loaded.home}
    if as_json:
        joints = [
            {"name": name, "limits": limits.tolist()}
            | {key: float(numbers[i]) if np.isfinite(numbers[i]) else None for key, numbers in columns.items()}
            for i, (name, limits) in enumerate(zip(loaded.joints, loaded.joint_limits, strict=True))
        ]
        print_json({"name": loaded.name, "payload": loaded.payload, "joints": joints, "assumed": loaded.assumptions})
        return
    rows = [
        (name, f"{low:.4g} .. {high:.4g}", *(f"{numbers[i]:.4g}" for numbers in columns.values()))
        for i, (name, (low, high)) in enumerate(zip(loaded.joints, loaded.joint_limits, strict=True))
    ]
    print_table(f"{loaded.name}: {loaded.payload:g} kg at the flange", ("joint", "range", *columns), rows)
    for sentence in loaded.assumptions:
        typer.echo(f"assumed: {sentence}")


@arm_app.command("new")
def new(
    urdf: Annotated[Path, typer.Argument(help="The URDF, xacro or MJCF file; a gripper in it is left out.")],
    out: Annotated[Path, typer.Option(help="Write this file.")] = Path("arm.toml"),
    name: Annotated[str | None, typer.Option(help="Name of the arm; that of the file by default.")] = None,
    base: Annotated[str | None, typer.Option(metavar="LINK", help="By default the root of the file.")] = None,
    flange: Annotated[
        str | None, typer.Option(metavar="LINK", help="By default the end of the chain of joints, before a gripper.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Begin an arm.toml for a URDF: it loads, and begins with a list of guesses to review."""
    if out.exists() and not force:
        raise ConfigError(f"{str(out)!r} exists; pass --out for another file, or --force to replace it")
    check_output(out)
    try:
        draft = draft_arm(urdf, name=name, base=base, flange=flange)
    except (ArmError, FileError) as error:
        console.print(f"graspbox: {error}", soft_wrap=True)
        raise typer.Exit(2) from None
    write_text(out, draft.text)
    for guess in draft.guesses:
        typer.echo(f"guessed: {guess}")
    for sentence in draft.arm.assumptions:
        typer.echo(f"assumed: {sentence}")
    typer.echo(f"wrote {out}; use it as --arm {json.dumps(f'{urdf},{out}')}")
    sys.stdout.flush()
