"""Options of the commands that find grasps in depth images of real cameras: how they are read, and where to search."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox.arms import load_arm
from graspbox.captures.files import read_points, read_pose
from graspbox.cli.common import Seed, standing
from graspbox.errors import ConfigError
from graspbox.hands.loading import hand_like
from graspbox.perception.depth_images import camera_over_table, intrinsics_of
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.real import DepthKind, Frame, Workspace

__all__ = ["CameraPose", "ReadingOptions", "SearchOptions"]

CameraPose = Annotated[
    Path | None,
    typer.Option(
        help="File of table_from_camera, 4x4 (.npy, .json or text); z up, the table at z = 0, metres. Without a pose "
        "the table is found in the image."
    ),
]


@dataclass(frozen=True)
class ReadingOptions:
    """How a depth image is read."""

    intrinsics: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="FX FY CX CY",
            help="Focal lengths and principal point, pixels; by default those of the source or of --camera-info.",
        ),
    ] = None
    camera_info: Annotated[
        Path | None,
        typer.Option(
            help="File with intrinsics: ROS CameraInfo (.yaml, .json), OpenCV, RealSense, Open3D, BOP, .npy, or text."
        ),
    ] = None
    depth_scale: Annotated[
        float | None,
        typer.Option(
            help="Metres per unit of the file; by default as the source states, else 1 for floats, 0.001 for integers."
        ),
    ] = None
    depth_is: Annotated[
        DepthKind,
        typer.Option(help="What an image holds: depths along the optical axis, or distances along the pixels' rays."),
    ] = "z"
    topic: Annotated[
        str | None,
        typer.Option(help="Topic of a recording; by default the only one with depth images, or with clouds."),
    ] = None
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="NEAR FAR", help="Depths outside, metres, count as not measured."),
    ] = None

    def settings(self) -> dict[str, Any]:
        """Return arguments of `graspbox.captures.read_capture` and `graspbox.captures.open_camera`."""
        if self.intrinsics is not None and self.camera_info is not None:
            raise ConfigError("--intrinsics and --camera-info both state the intrinsics; pass one of them")
        lens = self.camera_info if self.intrinsics is None else intrinsics_of(*self.intrinsics)
        own = ("depth_scale", "depth_is", "topic", "limits")
        return {"intrinsics": lens, **{name: getattr(self, name) for name in own}}


@dataclass(frozen=True)
class SearchOptions:
    """Where the camera is, where grasps are searched, and for which hand."""

    camera_pose: CameraPose = None
    camera_height: Annotated[float | None, typer.Option(help="Height of the camera over the table, metres.")] = None
    tilt: Annotated[
        float | None, typer.Option(help="Degrees by which it is tilted down: 0 horizontal, 90 straight down.")
    ] = None
    gravity: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Direction of gravity in the camera's frame (x right, y down, z forward), as an accelerometer gives "
            "it, instead of its pose: only level planes are tables, and with --mask none need be seen.",
        ),
    ] = None
    region: Annotated[
        tuple[int, int, int, int] | None,
        typer.Option(
            metavar="LEFT TOP RIGHT BOTTOM",
            help="Pixels within which the object is searched for; all else remains an obstacle.",
        ),
    ] = None
    workspace: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z X Y Z",
            help="Least and greatest corner of a box, metres, within which the object is searched for; all else "
            "remains an obstacle. In the table's frame if the camera's pose is given, else in the camera's.",
        ),
    ] = None
    workspace_frame: Annotated[
        Frame | None,
        typer.Option(help="Another frame of --workspace; that of a table found in the image begins below the camera."),
    ] = None
    keep_off: Annotated[
        Path | None,
        typer.Option(
            help="Points of obstacles, such as the walls of a bin: .npy (k, 3), at most 8 mm apart, in the table's "
            "frame, metres; needs the camera's pose. Grasps keep off them where any can."
        ),
    ] = None
    hand_error: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="MILLIMETRES DEGREES",
            help="Positioning error of your hand, one standard deviation along and about each axis: grasps "
            "that tolerate it come first.",
        ),
    ] = None
    count: Annotated[int, typer.Option(min=1, max=100, help="Most grasps.")] = 5
    hand: Annotated[
        str | None, typer.Option(help="The hand, for a policy that grasps with any: a name, or URDF,TOML.")
    ] = None
    arm: Annotated[
        str | None,
        typer.Option(
            help="The arm that carries the hand, a name such as fr3 or URDF,TOML: grasps that it reaches come first, "
            "with its joints. All that is seen is an obstacle, but for the arm itself if --joints are given."
        ),
    ] = None
    base: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z YAW",
            help="Where the arm's base stands upright, in the table's frame: metres, and degrees about z; needs the "
            "camera's pose.",
        ),
    ] = None
    base_pose: Annotated[
        Path | None, typer.Option(help="File of table_from_base, 4x4, instead of --base, for any other pose.")
    ] = None
    joints: Annotated[
        str | None,
        typer.Option(
            metavar="'Q1 Q2 ...'",
            help="Positions of the arm's joints when the image, or all images, were taken, rad: pixels of the arm are "
            "left out.",
        ),
    ] = None
    seed: Seed = 0

    def table_from_base(self) -> NDArray[np.float64] | None:
        """Return the pose of the arm's base."""
        if self.base is not None and self.base_pose is not None:
            raise ConfigError("--base and --base-pose both place the arm; pass one of them")
        if self.base_pose is not None:
            return read_pose(self.base_pose)
        if self.base is None:
            return None
        return standing(self.base)

    def pose(self) -> NDArray[np.float64] | None:
        """Return the camera's pose; None if the table is to be found in the image."""
        if self.camera_pose is not None and (self.camera_height is not None or self.tilt is not None):
            raise ConfigError("--camera-pose and --camera-height both place the camera; pass one of them")
        if (self.camera_height is None) != (self.tilt is None):
            raise ConfigError(
                "a camera's pose needs both --camera-height and --tilt; without both the table is searched"
            )
        if self.camera_pose is not None:
            return read_pose(self.camera_pose)
        if self.camera_height is not None and self.tilt is not None:
            return camera_over_table(self.camera_height, float(np.radians(self.tilt)))
        return None

    def find(self) -> dict[str, Any]:
        """Return arguments of `ImageGrasper.find` and `ImageGrasper.find_all`."""
        return {
            "gravity": self.gravity,
            "count": self.count,
            "region": self.region,
            "workspace": Workspace.of(self.workspace, self.workspace_frame),
            "keep_off": None if self.keep_off is None else read_points(self.keep_off),
            "arm": None if self.arm is None else load_arm(hand_like(self.arm)),
            "base": self.table_from_base(),
            "joints": None if self.joints is None else _numbers(self.joints),
            "hand_error": None if self.hand_error is None else PoseNoise.in_millimetres(*self.hand_error),
            "seed": self.seed,
        }

    def request(self) -> dict[str, Any]:
        """Return the entries of a request to a server, without the camera's pose and what servers do not take."""
        box = Workspace.of(self.workspace, self.workspace_frame)
        corners = None if box is None else [box.low, box.high]
        boxed = {"workspace": corners, "workspace_frame": self.workspace_frame}
        own = {name: getattr(self, name) for name in ("count", "region", "hand_error", "seed")}
        return {name: value for name, value in {**own, **boxed}.items() if value is not None}


def _numbers(text: str) -> list[float]:
    """Read numbers with spaces or commas between."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise ConfigError(f"--joints is {text!r}; pass numbers, such as '0 -0.8 0 -2.4 0 1.6 0.8'") from None
