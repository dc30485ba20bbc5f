"""``graspbox grasp-image``: grasps for your own depth image."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox.captures import Capture, average, read_capture
from graspbox.captures.files import read_points, read_pose
from graspbox.cli.common import (
    Json,
    Rehearse,
    Seed,
    check_files,
    console,
    find_hand,
    print_json,
    print_table,
    write_json,
)
from graspbox.cli.recorders import CommandRecorder, Rerun, rerun_recorder
from graspbox.errors import ConfigError
from graspbox.perception.depth_images import camera_over_table, intrinsics_of
from graspbox.perception.perturbations import PoseNoise
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
IntrinsicsOption = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option(
        metavar="FX FY CX CY",
        help="Focal lengths and principal point, pixels; by default those of the source or of --camera-info.",
    ),
]
CameraInfoOption = Annotated[
    Path | None,
    typer.Option(
        help="File with intrinsics: ROS CameraInfo (.yaml, .json), OpenCV, RealSense, Open3D, BOP, .npy, or text."
    ),
]
TopicOption = Annotated[
    str | None, typer.Option(help="Topic of a recording; by default the only one with depth images, or with clouds.")
]
TimeOption = Annotated[
    float | None, typer.Option(help="Seconds from the beginning of the topic of a recording; by default 0.")
]
FramesOption = Annotated[
    int, typer.Option(min=1, help="Images of a recording that are averaged, from --time on, of a still scene.")
]
LimitsOption = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="NEAR FAR", help="Depths outside, metres, count as not measured."),
]
LabelOption = Annotated[
    int | None, typer.Option(help="The object's number in --mask, which is then an image of several objects.")
]
EverythingOption = Annotated[
    bool,
    typer.Option("--all", help="Find grasps of every object: those of --mask, or all that rise above the table."),
]
CameraPoseOption = Annotated[
    Path | None,
    typer.Option(
        help="File of table_from_camera, 4x4 (.npy, .json or text); z up, the table at z = 0, metres. "
        "Without it and --camera-height the table is found in the image."
    ),
]
CameraHeightOption = Annotated[float | None, typer.Option(help="Height of the camera over the table, metres.")]
TiltOption = Annotated[
    float | None, typer.Option(help="Degrees by which it is tilted down: 0 horizontal, 90 straight down.")
]
GravityOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Direction of gravity in the camera's frame (x right, y down, z forward), as an accelerometer gives it, "
        "instead of its pose: only level planes are tables, and with --mask none need be seen.",
    ),
]
RegionOption = Annotated[
    tuple[int, int, int, int] | None,
    typer.Option(metavar="LEFT TOP RIGHT BOTTOM", help="Pixels within which the object is searched for."),
]
MaskOption = Annotated[
    Path | None,
    typer.Option(
        help="Pixels of one of several objects, .npy or .png, not 0 where it is: grasps are of this one, and keep "
        "off the others."
    ),
]
KeepOffOption = Annotated[
    Path | None,
    typer.Option(
        help="Points of obstacles, such as the walls of a bin: .npy (k, 3), at most 8 mm apart, in the table's "
        "frame, metres; needs the camera's pose. Grasps keep off them where any can."
    ),
]
HandErrorOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="MILLIMETRES DEGREES",
        help="Positioning error of your hand, one standard deviation along and about each axis: grasps "
        "that tolerate it come first.",
    ),
]
HandOption = Annotated[
    str | None, typer.Option(help="The hand, for a policy that grasps with any: a name, or URDF,TOML.")
]
CountOption = Annotated[int, typer.Option(min=1, max=100, help="Most grasps.")]
DepthScaleOption = Annotated[
    float | None,
    typer.Option(
        help="Metres per unit of the file; by default as the source states, else 1 for floats, 0.001 for integers."
    ),
]


def given_pose(file: Path | None, height: float | None, tilt: float | None) -> NDArray[np.float64] | None:
    """Return the camera's pose of the options; None if the table is to be found in the image."""
    if file is not None and (height is not None or tilt is not None):
        raise ConfigError("--camera-pose and --camera-height both place the camera; pass one of them")
    if (height is None) != (tilt is None):
        raise ConfigError("a camera's pose needs both --camera-height and --tilt; without both the table is searched")
    if file is not None:
        return read_pose(file)
    if height is not None and tilt is not None:
        return camera_over_table(height, float(np.radians(tilt)))
    return None


def given_intrinsics(
    intrinsics: tuple[float, float, float, float] | None, camera_info: Path | None
) -> NDArray[np.float64] | Path | None:
    """Return the intrinsics of the options, a matrix or a file; None if the source states them."""
    if intrinsics is not None and camera_info is not None:
        raise ConfigError("--intrinsics and --camera-info both state the intrinsics; pass one of them")
    return camera_info if intrinsics is None else intrinsics_of(*intrinsics)


def find_options(
    gravity: tuple[float, float, float] | None,
    count: int,
    region: tuple[int, int, int, int] | None,
    keep_off: Path | None,
    hand_error: tuple[float, float] | None,
    seed: int,
) -> dict[str, Any]:
    """Return the options of the command line as those of `ImageGrasper.find` and `ImageGrasper.find_all`."""
    return {
        "gravity": gravity,
        "count": count,
        "region": region,
        "keep_off": None if keep_off is None else read_points(keep_off),
        "hand_error": None if hand_error is None else PoseNoise.in_millimetres(*hand_error),
        "seed": seed,
    }


def _capture(
    sources: list[Path],
    intrinsics: tuple[float, float, float, float] | None,
    camera_info: Path | None,
    depth_scale: float | None,
    mask: Path | None,
    label: int | None,
    topic: str | None,
    time: float | None,
    frames: int,
    limits: tuple[float, float] | None,
    everything: bool,
) -> Capture:
    """Read the sources with the options that describe them."""
    if label is not None and mask is None:
        raise ConfigError("--label chooses an object of --mask; pass both")
    marks = {"labels" if everything or label is not None else "mask": mask}
    settings: dict[str, Any] = {"depth_scale": depth_scale, "topic": topic, "time": time, "limits": limits, **marks}
    lens = given_intrinsics(intrinsics, camera_info)
    return average([read_capture(source, intrinsics=lens, frames=frames, **settings) for source in sources])


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
        rows.append((str(rank + 1), *shares, place, way))
    columns = ("rank", "success", "secure", "preshape", "position / m", "approach")
    print_table(f"{of}grasps of {grasps.hand.name}, camera frame", columns, rows)


def grasp_image_command(
    source: SourceArgument,
    policy: PolicyOption,
    intrinsics: IntrinsicsOption = None,
    camera_info: CameraInfoOption = None,
    depth_scale: DepthScaleOption = None,
    topic: TopicOption = None,
    time: TimeOption = None,
    frames: FramesOption = 1,
    limits: LimitsOption = None,
    camera_pose: CameraPoseOption = None,
    camera_height: CameraHeightOption = None,
    tilt: TiltOption = None,
    gravity: GravityOption = None,
    region: RegionOption = None,
    mask: MaskOption = None,
    label: LabelOption = None,
    everything: EverythingOption = False,
    keep_off: KeepOffOption = None,
    hand_error: HandErrorOption = None,
    rehearse: Rehearse = None,
    count: CountOption = 5,
    hand: HandOption = None,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Write the grasps into this JSON file.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a picture into this file.")] = None,
    rerun: Rerun = None,
    as_json: Json = False,
) -> None:
    """Find grasps of the object in your own depth image, with a published policy.

    Poses are those of the hand's grasp frame, in the frames of the camera (x right, y down, z forward) and of the
    table. Warnings say what was assumed of the source, and what may be wrong with it.
    """
    if everything and (picture or rerun or rehearse is not None or label is not None):
        raise ConfigError("--all writes no --picture and no --rerun, and takes no --rehearse and no --label")
    described = (intrinsics, camera_info, depth_scale, mask, label, topic, time, frames, limits, everything)
    seen = _capture(source, *described)
    check_files(out, picture)
    recorder = rerun_recorder(rerun)
    grasper = ImageGrasper(policy, hand=None if hand is None else find_hand(hand))
    place = (seen.depth, seen.intrinsics, given_pose(camera_pose, camera_height, tilt))
    options = find_options(gravity, count, region, keep_off, hand_error, seed)
    if everything:
        _report_all(grasper.find_all(*place, labels=seen.labels, **options), seen, out, as_json)
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
