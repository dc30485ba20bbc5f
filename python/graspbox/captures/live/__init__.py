"""Live sources of depth images: growing folders, RealSense cameras, topics of ROS 2, and recordings played."""

import os
from pathlib import Path

from numpy.typing import ArrayLike

from graspbox.captures.files import kind_of
from graspbox.captures.live.folder import FolderSource
from graspbox.captures.live.frames import Frame, LiveSource, Settings
from graspbox.captures.live.realsense import RealSenseSource
from graspbox.captures.live.recorded import RecordedSource
from graspbox.captures.live.ros2 import Ros2Source
from graspbox.captures.reading import PathLike, check_depth_kind, check_limits
from graspbox.captures.recordings import is_recording
from graspbox.errors import ConfigError, FileError
from graspbox.perception.real import DepthKind

__all__ = ["Frame", "LiveSource", "open_camera"]

_CHOICES = "a folder, realsense, realsense:SERIAL, ros2:/topic, or a recording"


def open_camera(
    source: PathLike,
    *,
    intrinsics: ArrayLike | PathLike | None = None,
    depth_scale: float | None = None,
    depth_is: DepthKind = "z",
    limits: tuple[float, float] | None = None,
    topic: str | None = None,
    seconds: float | None = None,
    timeout: float = 5.0,
    new_only: bool = False,
) -> LiveSource:
    """Open a camera, a folder that grows, or a recording, to iterate over its depth images.

    | source | images |
    |---|---|
    | a folder | every depth image and cloud in it, again when it changes; it ends with `seconds` alone |
    | ``realsense``, ``realsense:SERIAL`` | the newest of the camera (package pyrealsense2) |
    | ``ros2:/topic`` | the newest of Image, CompressedImage or PointCloud2 (rclpy, of an installation of ROS 2) |
    | ``.bag``, ``.db3``, ``.mcap``, a folder of ROS 2 | all of a topic, as fast as they are read |

    Files of a folder are read when they no longer grow, by modification time, then name. ``NAME_labels.png`` or
    ``NAME_mask.png`` marks things in ``NAME.png`` and is no depth. ``camera_info``, ``camera`` or ``intrinsics``
    (``.json``, ``.yaml``, ``.yml``) in the folder states the intrinsics of images that state none.

    Parameters
    ----------
    source : str or PathLike
        The source; a folder named as a camera is ``./realsense``.
    intrinsics, depth_scale, depth_is, limits
        As of `graspbox.captures.read_capture`; by default those of the source.
    topic : str, optional
        Topic of a recording; by default the only one with depth.
    seconds : float, optional
        Ends the iteration so long after its begin.
    timeout : float
        Seconds without an image after which a camera or a topic is lost.
    new_only : bool
        Leave out the files that a folder holds now.

    Returns
    -------
    LiveSource
        Yields `Frame`; close it, or use it in ``with``.

    Raises
    ------
    ConfigError, FileError
        If there is no such source, or an argument is wrong.
    ConnectionLostError
        If a camera does not start, or nobody publishes the topic.
    MissingExtraError
        If a package is missing.
    """
    _check(depth_scale, limits, seconds, timeout)
    check_depth_kind(depth_is)
    settings = Settings(intrinsics, depth_scale, depth_is, limits, seconds, timeout)
    if isinstance(intrinsics, str | os.PathLike) and not Path(intrinsics).is_file():
        raise FileError(2, "there is no such file of intrinsics", str(intrinsics))
    kind, _, rest = str(source).partition(":")
    path = Path(source)
    live = isinstance(source, str) and kind in ("realsense", "ros2")
    folder = not live and path.is_dir() and not is_recording(path, "")
    if new_only and not folder:
        raise ConfigError(f"{source} is no folder of images; new_only (--new-only) leaves out files of one")
    if topic is not None and (live or folder):
        raise ConfigError(f"{source} is no recording, of which topic (--topic) chooses; name a topic as ros2:/topic")
    if live and kind == "realsense":
        return RealSenseSource(rest, settings)
    if live:
        if not rest.startswith("/"):
            raise ConfigError(f"{source} names no topic; write it as ros2:/camera/depth/image_rect_raw")
        return Ros2Source(rest, settings)
    if folder:
        return FolderSource(path, settings, new_only)
    if not path.exists():
        raise FileError(2, f"there is no such source; name {_CHOICES}", str(path))
    if not is_recording(path, "" if path.is_dir() else kind_of(path)):
        raise ConfigError(f"{path} is one file; name {_CHOICES}, or read it with read_capture (graspbox grasp-image)")
    return RecordedSource(path, settings, topic)


def _check(
    depth_scale: float | None, limits: tuple[float, float] | None, seconds: float | None, timeout: float
) -> None:
    """Refuse wrong numbers before anything is opened."""
    if depth_scale is not None and not 0.0 < depth_scale < float("inf"):
        raise ConfigError(f"depth_scale is {depth_scale}; pass metres per unit of the image, such as 0.001")
    if limits is not None:
        check_limits(limits)
    for name, value in (("seconds", seconds), ("timeout", timeout)):
        if value is not None and not 0.0 < value < 1e9:
            raise ConfigError(f"{name} is {value}; pass a number of seconds above 0")
