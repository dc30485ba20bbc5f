"""``graspbox arm path``: a timed path of an arm to a grasp."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

import graspbox
from graspbox import pictures
from graspbox._common.entry_points import load_entry_point
from graspbox._common.options import flattened
from graspbox._common.rotations import upright_pose
from graspbox.arms import Trajectory, load_arm
from graspbox.arms.trajectories import FORMATS
from graspbox.cli import common
from graspbox.cli.arm.path_options import PathOptions, check_path_file, save_path, told_assumptions
from graspbox.errors import ArmError, ConfigError, PathError
from graspbox.hands.loading import hand_like
from graspbox.simulation.path_motion import PathMotion

__all__ = ["path_command"]


@flattened
def path_command(
    mesh: Annotated[str, typer.Argument(help="A mesh file, or an object set that names one object.")],
    base: Annotated[
        tuple[float, float, float, float],
        typer.Option(
            metavar="X Y Z YAW",
            help="Where the arm's base stands upright: metres, the object is at the origin; and degrees about z.",
        ),
    ],
    following: PathOptions,
    arm: Annotated[str, typer.Option(help="A name such as fr3, or URDF,TOML.")] = "fr3",
    hand: common.HandName = "panda_gripper",
    out: Annotated[
        Path | None, typer.Option(help=f"Write the trajectory here: {', '.join(FORMATS)} (YAML is a ROS message).")
    ] = None,
    video: Annotated[Path | None, typer.Option(help="Write a video here: .webp, .gif or .mp4.")] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Show it in a browser, with a time slider, until Ctrl-C.")
    ] = False,
    grasps: Annotated[int, typer.Option(min=1, max=10_000, help="Grasps that are tried, the best first.")] = 50,
    seed: common.Seed = 0,
    scale: common.Scale = 1.0,
    threads: common.Threads = None,
    as_json: common.Json = False,
) -> None:
    """Plan grasps of an object on a table, and the path of an arm to the best that it can carry out.

    Ends with exit status 1 if there is none. Nothing drives a robot.
    """
    check_path_file("--out", out)
    if following.prefix and out is None:
        raise ConfigError(f"--prefix is {following.prefix!r}, which names the joints in the file of --out; pass it too")
    if view and as_json:
        raise ConfigError("--view tells its address on standard output, where --json prints; leave one of them out")
    opened = load_entry_point("graspbox.viewers", "browser", "viewer", "install the extra 'view'") if view else None
    if video is not None:
        pictures.check_video(video)
    spec, with_hand, with_arm = common.find_one(mesh, scale), common.find_hand(hand), load_arm(hand_like(arm))
    try:
        with common.console.status("planning"):
            world_from_base = common.standing(base)
            thing = spec.load()
            rest = graspbox.Scene(thing, hand=with_hand).world_from_object
            made = _made(thing, rest, with_hand, with_arm, world_from_base, grasps, seed, threads, following)
    except (ArmError, PathError) as error:
        common.console.print(f"graspbox: {error}", soft_wrap=True)
        raise typer.Exit(1 if isinstance(error, PathError) else 2) from None
    if as_json:
        common.print_json({"object": spec.name, **made.to_json()})
    else:
        _show(made, spec.name)
    if out is not None:
        save_path(made, out, following)
    if video is not None:
        pictures.save_path(video, made, with_arm, with_hand, world_from_base, target=(thing, rest))
        common.console.print(f"wrote {video}")
    if opened is not None:
        opened(PathMotion.of(made, with_arm, with_hand, world_from_base, target=(thing, rest)))


def _made(
    mesh: graspbox.Mesh,
    rest: NDArray[np.float64],
    hand: graspbox.Hand,
    arm: graspbox.arms.Arm,
    world_from_base: NDArray[np.float64],
    grasps: int,
    seed: int,
    threads: int | None,
    following: PathOptions,
) -> Trajectory:
    """Plan grasps and the path; what was assumed of the arm is told on standard error."""
    planned = graspbox.plan(mesh, hand=hand, seed=seed, world_from_object=rest, num_threads=threads).best(grasps)
    there = None
    if (moved := following.moved()) is not None:
        there = rest.copy()
        there[:3, :3] = upright_pose(np.zeros(3), moved[2])[:3, :3] @ rest[:3, :3]
        there[:2, 3] += moved[:2]
    given = {"place": there, "config": graspbox.PathConfig(seed=seed), "num_threads": threads}
    with told_assumptions():
        return planned.path(arm, world_from_base, hand=hand, mesh=mesh, **given, **following.timing())


def _show(path: Trajectory, name: str) -> None:
    """Print where the phases begin and how long they take."""
    starts = np.flatnonzero(np.append(True, path.phases[1:] != path.phases[:-1]))
    ends = np.append(path.times[starts[1:]], path.duration)
    rows: list[tuple[str, ...]] = [
        (str(path.phases[start]), f"{path.times[start]:.2f}", f"{end - path.times[start]:.2f}")
        for start, end in zip(starts, ends, strict=True)
    ]
    title = f"{path.arm} with {path.hand_name}, {name}: {path.duration:.2f} s, grasp {path.grasp + 1}"
    common.print_table(title, ("phase", "from / s", "takes / s"), rows)
