"""``graspbox camera``: grasps for each image of a camera, a growing folder or a recording."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, NoReturn

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox.captures import LiveSource, open_camera
from graspbox.cli.camera.following import Summary, follow, lines_into
from graspbox.cli.camera.grasping import Grasping, LocalGrasping, ServedGrasping
from graspbox.cli.common import Seed, check_files, console, find_hand
from graspbox.cli.grasp_image import (
    CameraHeightOption,
    CameraInfoOption,
    CameraPoseOption,
    CountOption,
    DepthScaleOption,
    GravityOption,
    HandErrorOption,
    HandOption,
    IntrinsicsOption,
    KeepOffOption,
    LimitsOption,
    RegionOption,
    TiltOption,
    find_options,
    given_intrinsics,
    given_pose,
)
from graspbox.cli.policy_servers import is_url
from graspbox.cli.recorders import Rerun, rerun_recorder
from graspbox.errors import ConfigError
from graspbox.policies.grasp_image import ImageGrasper

__all__ = ["camera_command"]

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE",
        help="A folder into which depth images or clouds are written, realsense, realsense:SERIAL, ros2:/topic, or a "
        "ROS recording (.bag, .db3, .mcap, a folder).",
    ),
]
PolicyOption = Annotated[
    str,
    typer.Option(
        help="An installed policy such as depth, the folder of one, hf://owner/name, or ws://HOST:PORT of a server "
        "(graspbox serve-policy)."
    ),
]
TopicOption = Annotated[str | None, typer.Option(help="Topic of a recording; by default the only one with depth.")]
LabelOption = Annotated[
    int | None, typer.Option(help="The object's number in NAME_labels.png of a folder; by default the only one.")
]
EverythingOption = Annotated[
    bool, typer.Option("--all", help="Find grasps of every object: those of the labels, or all on the table.")
]
FramesOption = Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")]
SecondsOption = Annotated[float | None, typer.Option(help="Stop after this many seconds.")]
NewOnlyOption = Annotated[bool, typer.Option("--new-only", help="Leave out the files that the folder holds now.")]
OutOption = Annotated[Path | None, typer.Option(help="Append a line of JSON per frame to this file.")]
LinesOption = Annotated[bool, typer.Option("--json", help="Print a line of JSON per frame on standard output.")]


def _grasping(
    policy: str,
    hand: str | None,
    everything: bool,
    label: int | None,
    place: NDArray[np.float64] | None,
    **given: Any,
) -> Grasping:
    """Load the policy once, or connect to its server; `given` are arguments of `find_options`."""
    if not is_url(policy):
        grasper = ImageGrasper(policy, hand=None if hand is None else find_hand(hand))
        return LocalGrasping(grasper, place, everything, label, find_options(**given))
    keep_off = given.pop("keep_off")
    if everything or any(one is not None for one in (hand, keep_off, given.pop("gravity"))):
        raise ConfigError(
            "a policy on a server takes no --hand, --all, --gravity and --keep-off; name one of this machine"
        )
    return ServedGrasping(policy, {**given, "camera_pose": place}, label)


def _end(summary: Summary, source: LiveSource, seconds: float | None) -> NoReturn:
    """End the command where no frame was answered, with the reason."""
    if summary.failure is not None:
        raise summary.failure
    if not summary.frames and not summary.interrupted:
        within = "" if seconds is None else f" within {seconds:g} s"
        why = f"the last image was skipped: {source.refusal}" if source.refusal else "it holds none; check its name"
        raise ConfigError(f"{source.name} gave no frame{within}: {why}")
    raise typer.Exit(1)


def camera_command(
    source: SourceArgument,
    policy: PolicyOption,
    intrinsics: IntrinsicsOption = None,
    camera_info: CameraInfoOption = None,
    depth_scale: DepthScaleOption = None,
    topic: TopicOption = None,
    limits: LimitsOption = None,
    camera_pose: CameraPoseOption = None,
    camera_height: CameraHeightOption = None,
    tilt: TiltOption = None,
    gravity: GravityOption = None,
    region: RegionOption = None,
    label: LabelOption = None,
    everything: EverythingOption = False,
    keep_off: KeepOffOption = None,
    hand_error: HandErrorOption = None,
    count: CountOption = 5,
    hand: HandOption = None,
    seed: Seed = 0,
    frames: FramesOption = None,
    seconds: SecondsOption = None,
    new_only: NewOnlyOption = False,
    out: OutOption = None,
    rerun: Rerun = None,
    as_json: LinesOption = False,
) -> None:
    """Find grasps in every image of a camera, until it ends or Ctrl-C.

    Each frame is a line of JSON, as of `graspbox grasp-image`, with frame, time (the source's clock), source, seconds
    (of the policy), skipped; or refused, a sentence. The table is searched in each frame if no pose is given. The exit
    status is 1 if no frame has a grasp.
    """
    if rerun is not None and (everything or is_url(policy)):
        raise ConfigError(
            "--rerun records grasps of one object by a policy of this machine; leave out --rerun or --all"
        )
    if everything and label is not None:
        raise ConfigError("--all asks for every object, --label for one; leave either out")
    place = given_pose(camera_pose, camera_height, tilt)
    if keep_off is not None and place is None:
        raise ConfigError("--keep-off is in the table's frame; pass --camera-pose, or --camera-height and --tilt")
    check_files(out)
    recorder = rerun_recorder(rerun)
    settings: dict[str, Any] = {"depth_scale": depth_scale, "limits": limits, "topic": topic, "seconds": seconds}
    given: dict[str, Any] = {"gravity": gravity, "count": count, "region": region}
    given |= {"keep_off": keep_off, "hand_error": hand_error, "seed": seed}
    lens = given_intrinsics(intrinsics, camera_info)
    with ExitStack() as stack:
        images = stack.enter_context(open_camera(source, intrinsics=lens, new_only=new_only, **settings))
        grasping = _grasping(policy, hand, everything, label, place, **given)
        write = stack.enter_context(lines_into(out, as_json))
        record = None if recorder is None else stack.enter_context(recorder.stream_image_grasps())
        summary = follow(images, grasping, write, frames, record)
        if not summary.answered:
            _end(summary, images, seconds)
    if summary.failure is not None:
        raise summary.failure
    if not summary.grasped:
        console.print("no frame has a grasp", style="red")
        raise typer.Exit(1)
