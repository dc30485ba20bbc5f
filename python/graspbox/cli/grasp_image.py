"""``graspbox grasp-image``: grasps for your own depth image."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox._common.files import check_output, dumps, write_text
from graspbox.cli.common import Json, Rehearse, Seed, console, find_hand, print_json, print_table
from graspbox.cli.exports.recording import Rerun, check_rerun
from graspbox.errors import ConfigError
from graspbox.perception.depth_images import camera_over_table, read_depth, read_mask, read_points, read_pose
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies.grasp_image import ImageGrasps, grasp_image

PolicyOption = Annotated[
    str, typer.Option("--policy", help="An installed policy such as depth, the folder of one, or hf://owner/name.")
]
CameraPoseOption = Annotated[
    Path | None,
    typer.Option(
        "--camera-pose",
        help="File of table_from_camera, 4x4 (.npy, .json or text); z up, the table at z = 0, metres. "
        "Without it and --camera-height the table is found in the image.",
    ),
]
CameraHeightOption = Annotated[
    float | None, typer.Option("--camera-height", help="Height of the camera over the table, metres.")
]
TiltOption = Annotated[
    float | None, typer.Option("--tilt", help="Degrees by which it is tilted down: 0 horizontal, 90 straight down.")
]
RegionOption = Annotated[
    tuple[int, int, int, int] | None,
    typer.Option("--region", metavar="LEFT TOP RIGHT BOTTOM", help="Pixels within which the object is looked for."),
]
MaskOption = Annotated[
    Path | None,
    typer.Option(
        "--mask",
        help="Pixels of one of several objects, .npy or .png, not 0 where it is: grasps are of this one, and keep "
        "off the others.",
    ),
]
KeepOffOption = Annotated[
    Path | None,
    typer.Option(
        "--keep-off",
        help="Points of what stands there, such as the walls of a bin: .npy (k, 3), at most 8 mm apart, in the table's "
        "frame, metres; needs the camera's pose. Grasps keep off them where any can.",
    ),
]
HandErrorOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--hand-error",
        metavar="MILLIMETRES DEGREES",
        help="Positioning error of your hand, one standard deviation along and about each axis: grasps "
        "that tolerate it come first.",
    ),
]
DepthScaleOption = Annotated[
    float | None,
    typer.Option("--depth-scale", help="Metres per unit of the file; by default 1 for floats, 0.001 for integers."),
]


def _pose(file: Path | None, height: float | None, tilt: float | None) -> NDArray[np.float64] | None:
    """Give the camera's pose that the options state; None where the table is searched for."""
    if file is not None and (height is not None or tilt is not None):
        raise ConfigError("--camera-pose and --camera-height both place the camera; give one")
    if (height is None) != (tilt is None):
        raise ConfigError("a camera's pose needs both --camera-height and --tilt; without both the table is searched")
    if file is not None:
        return read_pose(file)
    if height is not None and tilt is not None:
        return camera_over_table(height, float(np.radians(tilt)))
    return None


def _write(found: ImageGrasps, out: Path | None, picture: Path | None, rerun: Path | None) -> None:
    """Write the files that the options name."""
    if out is not None:
        write_text(out, dumps(found.to_json()) + "\n")
    if picture is not None:
        from graspbox import pictures

        pictures.save_grasp_image(picture, found)
    if rerun is not None:
        from graspbox.rerun import log

        log(found, rerun)
        console.print(f"wrote {rerun}")


def _check_outputs(out: Path | None, picture: Path | None, rerun: Path | None) -> None:
    """Refuse files that cannot be written before anything is computed."""
    check_rerun(rerun)
    if out is not None:
        check_output(out)
    if picture is not None:
        from graspbox import pictures

        pictures.check_path(picture)


def _print_table(pose: NDArray[np.float64]) -> None:
    down = np.degrees(np.arcsin(-pose[2, 2]))
    console.print(f"table found: the camera is {pose[2, 3]:.3f} m above it and looks down by {down:.1f} degrees")


def _print(found: ImageGrasps) -> None:
    rows: list[tuple[str, ...]] = []
    for rank, pose in enumerate(found.camera_from_hand):
        place = " ".join(f"{x:.3f}" for x in pose[:3, 3])
        way = " ".join(f"{x:.2f}" for x in pose[:3, 2])
        shares = (f"{found.success[rank]:.0%}", f"{found.secure[rank]:.0%}", f"{found.preshape[rank]:.2f}")
        rows.append((str(rank + 1), *shares, place, way))
    columns = ("rank", "success", "secure", "preshape", "position / m", "approach")
    print_table(f"grasps of {found.hand.name}, camera frame", columns, rows)


def grasp_image_command(
    image: Annotated[
        Path, typer.Argument(metavar="DEPTH", help="Depth image: .npy (H, W), or .png with 16 bits per pixel.")
    ],
    policy: PolicyOption,
    intrinsics: Annotated[
        tuple[float, float, float, float],
        typer.Option("--intrinsics", metavar="FX FY CX CY", help="Focal lengths and principal point, pixels."),
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
    count: Annotated[int, typer.Option("--count", min=1, max=100, help="Most grasps.")] = 5,
    hand: Annotated[
        str | None, typer.Option("--hand", help="The hand, for a policy that grasps with any: a name, or URDF,TOML.")
    ] = None,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option("--out", help="Write the grasps into this JSON file.")] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="Write a picture into this file.")] = None,
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
    _check_outputs(out, picture, rerun)
    pose = _pose(camera_pose, camera_height, tilt)
    error = None if hand_error is None else PoseNoise.in_millimetres(*hand_error)
    chosen = None if hand is None else find_hand(hand)
    found = grasp_image(
        depth,
        lens,
        pose,
        policy,
        hand=chosen,
        count=count,
        region=region,
        mask=None if mask is None else read_mask(mask),
        keep_off=None if keep_off is None else read_points(keep_off),
        hand_error=error,
        rehearsed=rehearse,
        seed=seed,
    )
    if pose is None:
        _print_table(found.table_from_camera)
    _write(found, out, picture, rerun)
    if as_json:
        print_json(found.to_json())
    else:
        _print(found)
    if not len(found):
        console.print("no grasp of the object is feasible", style="red")
        raise typer.Exit(1)
