"""``graspbox grasp-image``: grasps for your own depth image."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

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
from graspbox.perception.depth_images import camera_over_table, read_depth, read_mask, read_points, read_pose
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies.grasp_image import ImageGrasps, grasp_image

PolicyOption = Annotated[
    str, typer.Option(help="An installed policy such as depth, the folder of one, or hf://owner/name.")
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
DepthScaleOption = Annotated[
    float | None, typer.Option(help="Metres per unit of the file; by default 1 for floats, 0.001 for integers.")
]


def _pose(file: Path | None, height: float | None, tilt: float | None) -> NDArray[np.float64] | None:
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


def _print(grasps: ImageGrasps) -> None:
    rows: list[tuple[str, ...]] = []
    for rank, pose in enumerate(grasps.camera_from_hand):
        place = " ".join(f"{x:.3f}" for x in pose[:3, 3])
        way = " ".join(f"{x:.2f}" for x in pose[:3, 2])
        shares = (f"{grasps.success[rank]:.0%}", f"{grasps.secure[rank]:.0%}", f"{grasps.preshape[rank]:.2f}")
        rows.append((str(rank + 1), *shares, place, way))
    columns = ("rank", "success", "secure", "preshape", "position / m", "approach")
    print_table(f"grasps of {grasps.hand.name}, camera frame", columns, rows)


def grasp_image_command(
    image: Annotated[
        Path, typer.Argument(metavar="DEPTH", help="Depth image: .npy (H, W), or .png with 16 bits per pixel.")
    ],
    policy: PolicyOption,
    intrinsics: Annotated[
        tuple[float, float, float, float],
        typer.Option(metavar="FX FY CX CY", help="Focal lengths and principal point, pixels."),
    ],
    depth_scale: DepthScaleOption = None,
    camera_pose: CameraPoseOption = None,
    camera_height: CameraHeightOption = None,
    tilt: TiltOption = None,
    region: RegionOption = None,
    mask: MaskOption = None,
    keep_off: KeepOffOption = None,
    hand_error: HandErrorOption = None,
    rehearse: Rehearse = None,
    count: Annotated[int, typer.Option(min=1, max=100, help="Most grasps.")] = 5,
    hand: Annotated[
        str | None, typer.Option(help="The hand, for a policy that grasps with any: a name, or URDF,TOML.")
    ] = None,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Write the grasps into this JSON file.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a picture into this file.")] = None,
    rerun: Rerun = None,
    as_json: Json = False,
) -> None:
    """Find grasps of the object in your own depth image, with a published policy.

    Poses are those of the hand's grasp frame, in the frames of the camera (x right, y down, z forward) and of the
    table.
    """
    depth = read_depth(image, depth_scale)
    fx, fy, cx, cy = intrinsics
    lens = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    check_files(out, picture)
    recorder = rerun_recorder(rerun)
    pose = _pose(camera_pose, camera_height, tilt)
    grasps = grasp_image(
        depth,
        lens,
        pose,
        policy,
        hand=None if hand is None else find_hand(hand),
        count=count,
        region=region,
        mask=None if mask is None else read_mask(mask),
        keep_off=None if keep_off is None else read_points(keep_off),
        hand_error=None if hand_error is None else PoseNoise.in_millimetres(*hand_error),
        rehearsed=rehearse,
        seed=seed,
    )
    if pose is None:
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
