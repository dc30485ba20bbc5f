"""``graspbox arm path``: a timed path of an arm to a grasp."""

import warnings
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import graspbox
from graspbox._common.rotations import upright_pose
from graspbox.arms import Trajectory, load_arm
from graspbox.arms.trajectories import FORMATS
from graspbox.cli import common
from graspbox.errors import ArmError, ConfigError, PathError
from graspbox.hands.loading import AssumedWarning

__all__ = ["path_command"]


def path_command(
    mesh: Annotated[str, typer.Argument(help="A mesh file, or an object set that names one object.")],
    base: Annotated[
        tuple[float, float, float, float],
        typer.Option(
            metavar="X Y Z YAW",
            help="Where the arm's base stands upright: metres, the object is at the origin; and degrees about z.",
        ),
    ],
    arm: Annotated[str, typer.Option(help="A name such as fr3, or URDF,TOML.")] = "fr3",
    hand: common.HandName = "panda_gripper",
    place: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y YAW", help="Place the object so far from where it is: metres, and degrees about z."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help=f"Write the trajectory here: {', '.join(FORMATS)} (YAML is a ROS message).")
    ] = None,
    grasps: Annotated[int, typer.Option(min=1, max=10_000, help="Grasps that are tried, the best first.")] = 50,
    speed: Annotated[float, typer.Option(min=0.001, max=1.0, help="Share of the arm's speeds.")] = 1.0,
    hand_time: Annotated[float, typer.Option(min=0.0, help="Seconds for the hand to close, and to open.")] = 1.0,
    max_duration: Annotated[float | None, typer.Option(help="Refuse a longer path, seconds.")] = None,
    hz: Annotated[float, typer.Option(min=0.1, max=10_000.0, help="Samples per second.")] = 100.0,
    seed: common.Seed = 0,
    scale: common.Scale = 1.0,
    threads: common.Threads = None,
    as_json: common.Json = False,
) -> None:
    """Plan grasps of an object on a table, and the path of an arm to the best that it can carry out.

    Ends with exit status 1 if there is none. Nothing drives a robot.
    """
    common.check_files(out)
    if out is not None and out.suffix.lower() not in FORMATS:
        raise ConfigError(f"--out {str(out)!r} has none of the suffixes {', '.join(FORMATS)}")
    spec, with_hand, with_arm = common.find_one(mesh, scale), common.find_hand(hand), load_arm(common.hand_like(arm))
    try:
        with common.console.status("planning"):
            options = {"speed": speed, "hand_time": hand_time, "max_duration": max_duration, "hz": hz}
            made = _made(spec, with_hand, with_arm, base, place, grasps, seed, threads, **options)
    except (ArmError, PathError) as error:
        common.console.print(f"graspbox: {error}", soft_wrap=True)
        raise typer.Exit(1 if isinstance(error, PathError) else 2) from None
    _show(made, spec.name, as_json)
    if out is not None:
        made.save(out)
        common.console.print(f"wrote {out}")


def _made(
    spec: graspbox.object_sets.ObjectSpec,
    hand: graspbox.Hand,
    arm: graspbox.arms.Arm,
    base: tuple[float, float, float, float],
    place: tuple[float, float, float] | None,
    grasps: int,
    seed: int,
    threads: int | None,
    **options: float | None,
) -> Trajectory:
    """Plan grasps and the path; what was assumed of the arm is told on standard error."""
    mesh = spec.load()
    rest = graspbox.Scene(mesh, hand=hand).world_from_object
    planned = graspbox.plan(mesh, hand=hand, seed=seed, world_from_object=rest, num_threads=threads).best(grasps)
    there = None
    if place is not None:
        there = rest.copy()
        there[:3, :3] = upright_pose(np.zeros(3), np.radians(place[2]))[:3, :3] @ rest[:3, :3]
        there[:2, 3] += place[:2]
    world_from_base = upright_pose(base[:3], np.radians(base[3]))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AssumedWarning)
        config = graspbox.PathConfig(seed=seed)
        given = {"place": there, "config": config, "num_threads": threads}
        made = planned.path(arm, world_from_base, hand=hand, mesh=mesh, **given, **options)
    for warning in caught:
        common.console.print(f"warning: {warning.message}", style="yellow", soft_wrap=True)
    return made


def _show(made: Trajectory, name: str, as_json: bool) -> None:
    """Print where the phases begin and how long they take, or all samples as JSON."""
    if as_json:
        common.print_json({"object": name, **made.to_json()})
        return
    starts = np.flatnonzero(np.append(True, made.phases[1:] != made.phases[:-1]))
    ends = np.append(made.times[starts[1:]], made.duration)
    rows: list[tuple[str, ...]] = [
        (str(made.phases[start]), f"{made.times[start]:.2f}", f"{end - made.times[start]:.2f}")
        for start, end in zip(starts, ends, strict=True)
    ]
    title = f"{made.arm} with {made.hand_name}, {name}: {made.duration:.2f} s, grasp {made.grasp + 1}"
    common.print_table(title, ("phase", "from / s", "takes / s"), rows)
