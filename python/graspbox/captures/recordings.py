"""Depth of ROS recordings (ROS 1 ``.bag``; ROS 2 folders, ``.db3``, ``.mcap``), those of RealSense's SDK included.

The package rosbags opens the files; `graspbox.captures.messages` decodes the messages.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any

from graspbox._common.imports import imported
from graspbox.captures.cameras import camera_of
from graspbox.captures.capture import Camera, Found, listed
from graspbox.captures.messages import cloud_of, depth_of, encoding_of, is_depth
from graspbox.errors import ConfigError, FileError, GraspboxError

__all__ = ["is_recording", "read_recording"]

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CLOUDS, _INFOS = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/CameraInfo"
#: Topics of RealSense's SDK: the sensor and the stream.
_SDK = re.compile(r"(/device_\d+/sensor_\d+)/([^/]+)/image/data$")
#: The SDK's option with metres per unit, and the unit that most of its cameras have.
_UNITS, _USUAL_UNIT = r"/option/Depth[ _]Units/value$", 0.001
#: Suffixes of topics that name the transport, not the image.
_TRANSPORTS = ("compresseddepth", "compressed", "image_transport")
#: Older versions of the SDK write the unit after each image, bytes.
_EXCESS = 4


def is_recording(path: Path, kind: str) -> bool:
    """Tell whether a path is a recording: a file of one, or a folder with ``metadata.yaml``."""
    return kind in ("bag", "db3", "mcap") or (path.is_dir() and (path / "metadata.yaml").is_file())


def read_recording(
    path: Path, topic: str | None, time: float | None, frame: int | None, scale: float | None = None
) -> Found:
    """Read a depth image or a cloud of a recording, with its camera.

    Parameters
    ----------
    path : Path
        The file or folder.
    topic : str, optional
        The topic; by default the only one of depth images, or without any the only one of clouds.
    time : float, optional
        Seconds since the first message of the topic: the first message from then on.
    frame : int, optional
        Its number from 0; by default the first.
    scale : float, optional
        Metres per unit; by default that of a recording of RealSense's SDK.

    Raises
    ------
    ConfigError
        If it cannot be read, has several such topics, or no such message; if its CameraInfo belongs to another image.
    MissingExtraError
        Without rosbags (extra ``recordings``).
    """
    with _opened(path) as bag:
        name = _topic(bag, topic)
        connection = bag.of(name)
        message = bag.message(connection, time, frame)
        label = f"{name} of {path}"
        if connection.msgtype == _CLOUDS:
            frame_id = str(message.header.frame_id)
            found = Found(label, points=cloud_of(message, label))
            found.warnings.append(f"the points of {name} are taken as in the frame of a camera (x right, y down, z "
                                  f"forward); their frame is {frame_id!r}")  # fmt: skip
            return found
        found = Found(label, image=depth_of(message, label))
        found.camera = _camera(bag, name, message)
        found.scale = scale
        if scale is None and found.image is not None and found.image.dtype.kind == "u" and (sdk := _SDK.match(name)):
            found.scale = _unit(bag, sdk[1], found.warnings)
        return found


class _Recording:
    """An opened recording: connections by topic, and their messages."""

    def __init__(self, reader: Any, path: Path) -> None:
        self._reader, self.path = reader, path
        self.connections = list(reader.connections)

    def of(self, topic: str) -> Any:
        """Return the connection of a topic."""
        return next(one for one in self.connections if one.topic == topic)

    def topics(self, *kinds: str) -> list[str]:
        """Names of the topics of some types, sorted."""
        return sorted({one.topic for one in self.connections if one.msgtype in kinds})

    def first(self, topic: str) -> Any:
        """Return the first message of a topic, None if there is none."""
        every = self._reader.messages(connections=[self.of(topic)])
        return next((self._decoded(connection, data) for connection, _, data in every), None)

    def message(self, connection: Any, time: float | None, frame: int | None) -> Any:
        """Return the message of a connection at a time or of a number."""
        if time is not None and frame is not None:
            raise ConfigError("time and frame both choose a message; pass one of them")
        if (frame or 0) < 0 or not 0 <= (time or 0.0) < 1e9:
            raise ConfigError(f"the message at {time} s or of the number {frame} does not exist; pass 0 or more")
        start = None
        if time is not None:
            begun = next((stamp for _, stamp, _ in self._reader.messages(connections=[connection])), 0)
            start = begun + round(time * 1e9)
        every = self._reader.messages(connections=[connection], start=start)
        found = next(islice(every, frame or 0, None), None)
        if found is None:
            asked = f"from {time} s on" if time is not None else f"of the number {frame or 0}"
            raise ConfigError(
                f"{self.path} has no message {asked} of {connection.topic}; it has {connection.msgcount} of them"
            )
        return self._decoded(connection, found[2])

    def _decoded(self, connection: Any, data: Any) -> Any:
        try:
            return self._reader.deserialize(data, connection.msgtype)
        except Exception:
            if not _SDK.match(connection.topic):
                raise
            return self._reader.deserialize(bytes(data)[:-_EXCESS], connection.msgtype)


@contextmanager
def _opened(path: Path) -> Iterator[_Recording]:
    """Open a recording; whatever rosbags raises for broken files becomes a ConfigError."""
    need = "recordings are read with the package rosbags, from the extra 'recordings'"
    rosbags = imported("rosbags.highlevel", need, "recordings")
    stores = imported("rosbags.typesys", need, "recordings")
    if not path.exists():
        raise FileError(2, "there is no such recording", str(path))
    try:
        # Files of ROS 2 before 2023 have no definitions of messages.
        default = stores.get_typestore(stores.Stores.ROS2_FOXY)
        with rosbags.AnyReader([path], default_typestore=default) as reader:
            yield _Recording(reader, path)
    except GraspboxError:
        raise
    except Exception as error:  # the package raises many kinds, assertions included
        why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ConfigError(
            f"{path} cannot be read as a recording ({why}); try `ros2 bag reindex` or `rosbag reindex`, or record again"
        ) from None


def _topic(bag: _Recording, topic: str | None) -> str:
    """Return the topic to read, the only one of its kind if none is named."""
    depths = [one for one in bag.topics(*_IMAGES) if _holds_depth(bag, one)]
    clouds = bag.topics(_CLOUDS)
    if topic is not None:
        if topic in depths or topic in clouds:
            return topic
        known = listed([*depths, *clouds]) or "none"
        raise ConfigError(f"{bag.path} has no depth image or cloud of the topic {topic!r}; topics with depth: {known}")
    chosen = depths or clouds
    if not chosen:
        known = listed(sorted({one.topic for one in bag.connections})) or "none"
        raise ConfigError(f"{bag.path} has no topic of depth images or clouds; its topics: {known}")
    if len(chosen) > 1:
        raise ConfigError(f"{bag.path} has several topics with depth; choose one by --topic or topic: {listed(chosen)}")
    return chosen[0]


def _holds_depth(bag: _Recording, topic: str) -> bool:
    message = bag.first(topic)
    return message is not None and is_depth(encoding_of(message), topic)


def _base(topic: str) -> PurePosixPath:
    """Return a topic without its transport."""
    path = PurePosixPath(topic)
    return path.parent if path.name.lower() in _TRANSPORTS else path


def _camera(bag: _Recording, topic: str, message: Any) -> Camera | None:
    """Return the camera of an image topic by its CameraInfo; None if the recording has none for it."""
    sdk = _SDK.match(topic)
    path, frame_id = _base(topic), str(message.header.frame_id)
    own = f"{sdk[1]}/{sdk[2]}/info/camera_info" if sdk else str(path.parent / "camera_info")
    infos = {one: info for one in bag.topics(_INFOS) if (info := bag.first(one)) is not None}
    if own not in infos:
        same = [one for one, info in infos.items() if not sdk and frame_id and info.header.frame_id == frame_id]
        if len(same) > 1:
            raise ConfigError(
                f"{bag.path} has no {own} and several CameraInfo of the frame {frame_id!r} ({listed(same)}); pass the "
                "intrinsics of the depth image"
            )
        if not same:
            return None
        own = same[0]
    info = infos[own]
    # The SDK's frames are placeholders.
    if not sdk and str(info.header.frame_id) != frame_id:
        raise ConfigError(
            f"{topic} has the frame {frame_id!r} and {own} the frame {str(info.header.frame_id)!r}, so that they "
            "belong to different cameras; pass the intrinsics of the depth image"
        )
    use = "aligned" if "aligned_depth" in topic else "rectified" if "rect" in path.name.lower() else "raw"
    return camera_of(_entries(info), f"{own} of {bag.path}", use)


def _entries(info: Any) -> dict[str, Any]:
    """Return the entries of a CameraInfo of ROS 1 (K) or ROS 2 (k)."""

    def value(name: str) -> Any:
        return getattr(info, name.lower()) if hasattr(info, name.lower()) else getattr(info, name.upper())

    entries = {name: [float(one) for one in value(name)] for name in "kdp"}
    roi = {name: int(getattr(info.roi, name)) for name in ("x_offset", "y_offset", "width", "height")}
    sizes = {name: int(getattr(info, name)) for name in ("width", "height", "binning_x", "binning_y")}
    return {**entries, **sizes, "roi": roi, "model": str(info.distortion_model)}


def _unit(bag: _Recording, sensor: str, notes: list[str]) -> float:
    """Return metres per unit of a sensor, as RealSense's SDK records it: a number, or text in newer versions."""
    for connection in bag.connections:
        if re.match(re.escape(sensor) + _UNITS, connection.topic):
            message = bag.first(connection.topic)
            try:
                unit = float(message.data)
            except (AttributeError, TypeError, ValueError):
                continue
            if 0.0 < unit < 1.0:
                return float(f"{unit:.6g}")  # a float32
    notes.append(f"the recording does not state the unit of its depth, taken as {_USUAL_UNIT:g} m")
    return _USUAL_UNIT
