"""``graspbox camera``: grasps for each image of a camera, a growing folder or a recording."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, NoReturn

import numpy as np
import typer
from numpy.typing import NDArray

from graspbox._common.options import flattened
from graspbox.captures import LiveSource, open_camera
from graspbox.cli.camera.following import Summary, follow, lines_into
from graspbox.cli.camera.grasping import Grasping, LocalGrasping, ServedGrasping
from graspbox.cli.camera.options import ReadingOptions, SearchOptions
from graspbox.cli.common import check_files, console, find_hand
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
    policy: str, search: SearchOptions, everything: bool, label: int | None, place: NDArray[np.float64] | None
) -> Grasping:
    """Load the policy once, or connect to its server."""
    if not is_url(policy):
        grasper = ImageGrasper(policy, hand=None if search.hand is None else find_hand(search.hand))
        return LocalGrasping(grasper, place, everything, label, search.find())
    here = (search.hand, search.keep_off, search.gravity, search.arm, search.base, search.base_pose, search.joints)
    if everything or any(one is not None for one in here):
        raise ConfigError(
            "a policy on a server takes no --hand, --all, --gravity, --keep-off and --arm; name one of this machine"
        )
    request = {"camera_pose": place, **search.request()}
    return ServedGrasping(policy, request, label)


def _end(summary: Summary, source: LiveSource, seconds: float | None) -> NoReturn:
    """End the command where no frame was answered, with the reason."""
    if summary.failure is not None:
        raise summary.failure
    if not summary.frames and not summary.interrupted:
        within = "" if seconds is None else f" within {seconds:g} s"
        why = f"the last image was skipped: {source.refusal}" if source.refusal else "it holds none; check its name"
        raise ConfigError(f"{source.name} gave no frame{within}: {why}")
    raise typer.Exit(1)


@flattened
def camera_command(
    source: SourceArgument,
    policy: PolicyOption,
    reading: ReadingOptions,
    search: SearchOptions,
    label: LabelOption = None,
    everything: EverythingOption = False,
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
    place = search.pose()
    if search.keep_off is not None and place is None:
        raise ConfigError("--keep-off is in the table's frame; pass --camera-pose, or --camera-height and --tilt")
    check_files(out)
    recorder = rerun_recorder(rerun)
    with ExitStack() as stack:
        images = stack.enter_context(open_camera(source, seconds=seconds, new_only=new_only, **reading.settings()))
        grasping = _grasping(policy, search, everything, label, place)
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
