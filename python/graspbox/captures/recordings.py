"""Depth of ROS recordings (ROS 1 ``.bag``; ROS 2 folders, ``.db3``, ``.mcap``), those of RealSense's SDK included.

The package rosbags opens the files; `graspbox.captures.messages` decodes the messages.
"""

import re
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from itertools import islice
from pathlib import Path
from typing import Any

from graspbox._common.imports import imported
from graspbox.captures.capture import Camera, Found, listed
from graspbox.captures.messages import camera_of_info, encoding_of, found_of, info_topic, is_depth
from graspbox.errors import ConfigError, FileError, GraspboxError

__all__ = ["check_place", "is_recording", "read_recording", "recorded_images"]

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CLOUDS, _INFOS = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/CameraInfo"
#: Topics of RealSense's SDK: the sensor and the stream.
_SDK = re.compile(r"(/device_\d+/sensor_\d+)/([^/]+)/image/data$")
#: The SDK's option with metres per unit, and the unit that most of its cameras have.
_UNITS, _USUAL_UNIT = r"/option/Depth[ _]Units/value$", 0.001
#: Older versions of the SDK write the unit after each image, bytes.
_EXCESS = 4


def is_recording(path: Path, kind: str) -> bool:
    """Tell whether a path is a recording: a file of one, or a folder with ``metadata.yaml``."""
    return kind in ("bag", "db3", "mcap") or (path.is_dir() and (path / "metadata.yaml").is_file())


def check_place(time: float | None, frame: int | None) -> None:
    """Raise ConfigError if time, seconds, and number do not choose a message."""
    if time is not None and frame is not None:
        raise ConfigError("time and frame both choose a message; pass one of them")
    if (frame or 0) < 0 or not 0 <= (time or 0.0) < 1e9:
        raise ConfigError(f"the message at {time} s or of the number {frame} does not exist; pass 0 or more")


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
        source = _DepthTopic(bag, topic, scale)
        return source.found(bag.message(source.connection, time, frame))


def recorded_images(
    path: Path, topic: str | None = None, scale: float | None = None
) -> Generator[tuple[float, Callable[[], Found]], None, None]:
    """Iterate over all depth images or clouds of a topic; one at a time is in memory.

    Parameters and errors as of `read_recording`.

    Yields
    ------
    (float, callable)
        Time of the message in the recording, seconds; and a function that decodes it, valid until the next one. It
        raises ConfigError for a broken message, after which the iteration may go on.
    """
    with _opened(path) as bag:
        source = _DepthTopic(bag, topic, scale)
        # Nothing else may be read while messages are iterated.
        source.prepare()
        for stamp, data in bag.every(source.connection):
            yield stamp / 1e9, partial(source.decoded, data)


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
        return next((self.decoded(connection, data) for connection, _, data in every), None)

    def every(self, connection: Any) -> Iterator[tuple[int, Any]]:
        """Iterate over the messages of a connection: nanoseconds, and the data."""
        return ((stamp, data) for _, stamp, data in self._reader.messages(connections=[connection]))

    def message(self, connection: Any, time: float | None, frame: int | None) -> Any:
        """Return the message of a connection at a time or of a number."""
        check_place(time, frame)
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
        return self.decoded(connection, found[2])

    def decoded(self, connection: Any, data: Any) -> Any:
        """Decode the data of a message."""
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
    with _explained(path):
        # Files of ROS 2 before 2023 have no definitions of messages.
        default = stores.get_typestore(stores.Stores.ROS2_FOXY)
        with rosbags.AnyReader([path], default_typestore=default) as reader:
            yield _Recording(reader, path)


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn whatever rosbags raises for broken files into a ConfigError."""
    try:
        yield
    except GraspboxError:
        raise
    except Exception as error:  # the package raises many kinds, assertions included
        why = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ConfigError(
            f"{path} cannot be read as a recording ({why}); try `ros2 bag reindex` or `rosbag reindex`, or record again"
        ) from None


class _DepthTopic:
    """A topic of depth images or clouds of an opened recording; its cameras and its unit are read once."""

    def __init__(self, bag: _Recording, topic: str | None, scale: float | None) -> None:
        self._bag, self._scale = bag, scale
        self.name = _topic(bag, topic)
        self.connection = bag.of(self.name)
        self._sdk = _SDK.match(self.name)

    def prepare(self) -> None:
        """Read what `found` needs of other topics."""
        if self.connection.msgtype != _CLOUDS:
            _ = self._infos, self._unit

    def decoded(self, data: Any) -> Found:
        """Decode the data of a message."""
        with _explained(self._bag.path):
            return self.found(self._bag.decoded(self.connection, data))

    def found(self, message: Any) -> Found:
        """Return the depth image, with its camera and unit, or the cloud of a message."""
        found = found_of(message, self.name, f"{self.name} of {self._bag.path}")
        if found.image is None:
            return found
        found.camera = self._camera(message)
        found.scale = self._scale
        if self._scale is None and found.image.dtype.kind == "u" and self._sdk:
            found.scale = self._unit or _USUAL_UNIT
            if self._unit is None:
                found.warnings.append(f"the recording does not state the unit of its depth, taken as {_USUAL_UNIT:g} m")
        return found

    @cached_property
    def _infos(self) -> dict[str, Any]:
        """The first CameraInfo of each topic."""
        return {one: info for one in self._bag.topics(_INFOS) if (info := self._bag.first(one)) is not None}

    @cached_property
    def _unit(self) -> float | None:
        return _unit(self._bag, self._sdk[1]) if self._sdk else None

    def _camera(self, message: Any) -> Camera | None:
        """Return the camera of an image by its CameraInfo; None if the recording has none for it."""
        sdk, frame_id, path = self._sdk, str(message.header.frame_id), self._bag.path
        own = f"{sdk[1]}/{sdk[2]}/info/camera_info" if sdk else info_topic(self.name)
        if own not in self._infos:
            same = [one for one, info in self._infos.items() if not sdk and frame_id == info.header.frame_id != ""]
            if len(same) > 1:
                raise ConfigError(
                    f"{path} has no {own} and several CameraInfo of the frame {frame_id!r} ({listed(same)}); pass the "
                    "intrinsics of the depth image"
                )
            if not same:
                return None
            own = same[0]
        # The SDK's frames are placeholders.
        return camera_of_info(self._infos[own], own, self.name, None if sdk else frame_id, f" of {path}")


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


def _unit(bag: _Recording, sensor: str) -> float | None:
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
    return None
