"""``graspbox grasp-image``: grasps for your own depth image."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from graspbox._common.options import flattened
from graspbox.arms import Reach, Trajectory
from graspbox.arms.trajectories import FORMATS
from graspbox.captures import Capture, average, read_capture
from graspbox.captures.averaging import check_count
from graspbox.cli.arm.path_options import PathOptions, check_path_file, save_path, told_assumptions
from graspbox.cli.camera.options import ReadingOptions, SearchOptions
from graspbox.cli.common import Json, Rehearse, check_files, console, find_hand, print_json, print_table, write_json
from graspbox.cli.recorders import CommandRecorder, Rerun, rerun_recorder
from graspbox.errors import ConfigError, PathError
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps, SceneGrasps

SourceArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="SOURCE...",
        help="Depth image (.npy, .npz, 16-bit .png, .tiff, .exr), point cloud in the camera's frame (.ply, .pcd, "
        ".npy), or ROS recording (.bag, .db3, .mcap, a folder); several files are images of one still view, averaged.",
    ),
]
PolicyOption = Annotated[
    str, typer.Option(help="An installed policy such as depth, the folder of one, or hf://owner/name.")
]
TimeOption = Annotated[
    float | None, typer.Option(help="Seconds from the beginning of the topic of a recording; by default 0.")
]
FramesOption = Annotated[
    int, typer.Option(min=1, help="Images of a recording that are averaged, from --time on, of a still scene.")
]
LabelOption = Annotated[
    int | None, typer.Option(help="The object's number in --mask, which is then an image of several objects.")
]
EverythingOption = Annotated[
    bool,
    typer.Option("--all", help="Find grasps of every object: those of --mask, or all that rise above the table."),
]
MaskOption = Annotated[
    Path | None,
    typer.Option(
        help="Pixels of one of several objects, .npy or .png, not 0 where it is: grasps are of this one, and keep "
        "off the others."
    ),
]
PathOption = Annotated[
    Path | None,
    typer.Option(
        help=f"With --arm: write the path to the best grasp that has one ({', '.join(FORMATS)}; YAML is a ROS "
        "message); --place, --speed, --hand-time, --max-duration, --hz and --prefix are its."
    ),
]


def _capture(sources: list[Path], frames: int, given: dict[str, Any]) -> Capture:
    """Read the sources, one after another, with arguments of `read_capture`."""
    check_count(len(sources) * frames)
    return average(read_capture(source, frames=frames, **given) for source in sources)


def _write(grasps: ImageGrasps, out: Path | None, picture: Path | None, recorder: CommandRecorder | None) -> None:
    """Write the files that the options name."""
    if out is not None:
        write_json(out, grasps.to_json())
    if picture is not None:
        from graspbox import pictures

        pictures.save_grasp_image(picture, grasps)
        console.print(f"wrote {picture}")
    if recorder is not None:
        recorder.write_image_grasps(grasps)


def _print(grasps: ImageGrasps, of: str = "") -> None:
    rows: list[tuple[str, ...]] = []
    for rank, pose in enumerate(grasps.camera_from_hand):
        place = " ".join(f"{x:.3f}" for x in pose[:3, 3])
        way = " ".join(f"{x:.2f}" for x in pose[:3, 2])
        shares = (f"{grasps.success[rank]:.0%}", f"{grasps.secure[rank]:.0%}", f"{grasps.preshape[rank]:.2f}")
        reach = () if grasps.reach is None else (_posture(grasps.reach, rank),)
        rows.append((str(rank + 1), *shares, place, way, *reach))
    columns: tuple[str, ...] = ("rank", "success", "secure", "preshape", "position / m", "approach")
    columns += () if grasps.reach is None else (f"joints of {grasps.reach.arm} / rad",)
    print_table(f"{of}grasps of {grasps.hand.name}, camera frame", columns, rows)


def _posture(reach: Reach, row: int) -> str:
    """Return the joints with which a grasp is reached, or why it is not."""
    return " ".join(f"{x:.3f}" for x in reach.joints[row]) if reach.reached[row] else reach.why[row]


@flattened
def grasp_image_command(
    source: SourceArgument,
    policy: PolicyOption,
    reading: ReadingOptions,
    search: SearchOptions,
    following: PathOptions,
    time: TimeOption = None,
    frames: FramesOption = 1,
    mask: MaskOption = None,
    label: LabelOption = None,
    everything: EverythingOption = False,
    rehearse: Rehearse = None,
    out: Annotated[Path | None, typer.Option(help="Write the grasps into this JSON file.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a picture into this file.")] = None,
    path: PathOption = None,
    rerun: Rerun = None,
    as_json: Json = False,
) -> None:
    """Find grasps of the object in your own depth image, with a published policy.

    Poses are those of the hand's grasp frame, in the frames of the camera (x right, y down, z forward) and of the
    table. Warnings say what was assumed of the source, and what may be wrong with it.
    """
    if everything and (picture or rerun or rehearse is not None or label is not None):
        raise ConfigError("--all writes no --picture and no --rerun, and takes no --rehearse and no --label")
    if label is not None and mask is None:
        raise ConfigError("--label chooses an object of --mask; pass both")
    if path is not None and search.arm is None:
        raise ConfigError("--path is that of an arm; pass --arm and --base too")
    if path is None and following != PathOptions():
        raise ConfigError(
            "--place, --speed, --hand-time, --max-duration, --hz and --prefix are those of --path; pass it too"
        )
    marks = {"labels" if everything or label is not None else "mask": mask}
    seen = _capture(source, frames, {**reading.settings(), "time": time, **marks})
    check_files(out, picture)
    check_path_file("--path", path)
    recorder = rerun_recorder(rerun)
    grasper = ImageGrasper(policy, hand=None if search.hand is None else find_hand(search.hand))
    place, options = (seen.depth, seen.intrinsics, search.pose()), search.find()
    if everything:
        scene = grasper.find_all(*place, labels=seen.labels, **options)
        _report_all(scene, seen, out, as_json)
        _follow(scene, following, path)
        return
    chosen = None if mask is None else seen.mask(label)
    grasps = grasper.find(*place, mask=chosen, rehearsed=rehearse, **options)
    grasps = replace(grasps, warnings=(*seen.warnings, *grasps.warnings))
    _warn(grasps.warnings)
    if place[2] is None:
        height, down = grasps.table_from_camera[2, 3], np.degrees(np.arcsin(-grasps.table_from_camera[2, 2]))
        console.print(f"table found: the camera is {height:.3f} m above it and looks down by {down:.1f} degrees")
    _write(grasps, out, picture, recorder)
    if as_json:
        print_json(grasps.to_json())
    else:
        _print(grasps)
    if not len(grasps):
        console.print("no grasp of the object is feasible", style="red")
        raise typer.Exit(1)
    if grasps.reach is not None and not grasps.reach.reached.any():
        console.print(f"the arm {grasps.reach.arm} reaches no grasp of the object", style="red")
        raise typer.Exit(1)
    _follow(grasps, following, path)


def _follow(found: ImageGrasps | SceneGrasps, following: PathOptions, file: Path | None) -> None:
    """Plan, print and write the path of the arm, if a file is named; exits with 1 if there is none."""
    if file is None:
        return
    try:
        with told_assumptions():
            if isinstance(found, SceneGrasps):
                thing, path = found.path(place=following.moved(), **following.timing())
                grasps, of = found.grasps[thing], f" of object {thing}"
            else:
                path, grasps, of = found.path(place=following.moved(), **following.timing()), found, ""
    except PathError as error:
        console.print(str(error), style="red", soft_wrap=True)
        raise typer.Exit(1) from None
    console.print(f"a path of {path.duration:.2f} s to grasp {path.grasp + 1}{of}{_passed_over(grasps, path)}")
    save_path(path, file, following)


def _passed_over(grasps: ImageGrasps, path: Trajectory) -> str:
    """Say why better grasps than that of a path have none."""
    blocked = [str(rank + 1) for rank in range(path.grasp) if not grasps.free[rank]]
    without = [str(rank + 1) for rank in range(path.grasp) if grasps.free[rank]]
    told = {"the hand would touch something at": blocked, "no path leads to": without}
    return "".join(f"; {why} {', '.join(ranks)}" for why, ranks in told.items() if ranks)


def _warn(warnings: tuple[str, ...]) -> None:
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)


def _report_all(scene: SceneGrasps, seen: Capture, out: Path | None, as_json: bool) -> None:
    """Write and print the grasps of every object; exits with 1 if there are none."""
    _warn(seen.warnings)
    told = {**scene.to_json(), "warnings": list(seen.warnings)}
    if out is not None:
        write_json(out, told)
    if as_json:
        print_json(told)
    else:
        for label, grasps in scene.grasps.items():
            _warn(grasps.warnings)
            _print(grasps, f"object {label}, {int((scene.labels == label).sum())} pixels: ")
    for label, why in scene.refused.items():
        console.print(f"object {label}: {why}")
    if not scene.best():
        console.print("no grasp of an object is feasible", style="red")
        raise typer.Exit(1)
