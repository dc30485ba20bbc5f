"""Topics of ROS 2, by the package rclpy of its installation; messages are decoded as those of recordings."""

import threading
import time
from collections.abc import Generator
from functools import partial
from typing import Any, NamedTuple

from graspbox.captures.capture import Camera, Capture
from graspbox.captures.live.frames import Image, LiveSource, Settings, needed
from graspbox.captures.messages import camera_of_info, found_of, info_topic
from graspbox.errors import ConfigError, ConnectionLostError

__all__ = ["Ros2Source"]

_ADVICE = (
    "it comes with ROS 2, not with pip: source its setup file first, such as source /opt/ros/jazzy/setup.bash, and use "
    "the version of Python that this ROS 2 was made for"
)
#: Types of messages that hold depth.
_KINDS = ("Image", "CompressedImage", "PointCloud2")
#: Pause between two looks at the graph of topics, and longest wait for a message at once, seconds.
_PAUSE = 0.1


class _Newest(NamedTuple):
    """The newest message that nobody has taken, and how many it replaced."""

    message: Any
    missed: int


class Ros2Source(LiveSource):
    """A topic of depth images or clouds; a slow reader gets the newest message, and older ones are counted as skipped.

    The CameraInfo is that beside an image topic, as in recordings. Messages are received in a thread of their own.

    Parameters
    ----------
    topic : str
        The topic, of Image, CompressedImage or PointCloud2.
    settings : Settings
        Settings of every source.

    Raises
    ------
    MissingExtraError
        Without rclpy.
    ConnectionLostError
        If nobody publishes the topic.
    ConfigError
        If its messages are of another type.
    """

    def __init__(self, topic: str, settings: Settings) -> None:
        super().__init__(f"ros2:{topic}", settings)
        self._topic, self._given = topic, settings.camera()
        self._ready = threading.Condition()
        self._newest: _Newest | None = None
        self._info: Any = None
        what = f"the topic {topic}"
        rclpy, messages = needed("rclpy", what, _ADVICE), needed("sensor_msgs.msg", what, _ADVICE)
        executors, qos = needed("rclpy.executors", what, _ADVICE), needed("rclpy.qos", what, _ADVICE)
        # A context of its own leaves Ctrl-C, and other nodes of this process, alone.
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        try:
            self._node = rclpy.create_node("graspbox_camera", context=self._context)
            self._executor = executors.SingleThreadedExecutor(context=self._context)
            self._executor.add_node(self._node)
        except BaseException:
            self._context.try_shutdown()
            raise
        self._thread = threading.Thread(target=self._executor.spin, name="graspbox ros2", daemon=True)
        try:
            self._kind = self._found_kind()
            profile = qos.qos_profile_sensor_data
            self._node.create_subscription(getattr(messages, self._kind), topic, self._take, profile)
            if self._kind != "PointCloud2" and self._given is None:
                self._node.create_subscription(messages.CameraInfo, info_topic(topic), self._take_info, profile)
            self._thread.start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leave ROS 2."""
        super().close()
        self._executor.shutdown()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    def _found_kind(self) -> str:
        """Wait until the topic is published; return the type of its messages."""
        until = time.monotonic() + self._settings.timeout
        while True:
            topics = dict(self._node.get_topic_names_and_types())
            if self._topic in topics:
                kinds = [one.rpartition("/")[2] for one in topics[self._topic] if one.startswith("sensor_msgs/")]
                found = next((one for one in _KINDS if one in kinds), None)
                if found is None:
                    raise ConfigError(
                        f"{self._topic} has messages of {', '.join(topics[self._topic])}; name a topic of "
                        f"sensor_msgs/msg/{', '.join(_KINDS)}"
                    )
                return found
            if time.monotonic() > until:
                known = ", ".join(sorted(topics)) or "none"
                raise ConnectionLostError(
                    f"nobody publishes {self._topic}; topics: {known}. Check ros2 topic list and ROS_DOMAIN_ID"
                )
            time.sleep(_PAUSE)

    def _take(self, message: Any) -> None:
        with self._ready:
            missed = 0 if self._newest is None else self._newest.missed + 1
            self._newest = _Newest(message, missed)
            self._ready.notify()

    def _take_info(self, info: Any) -> None:
        with self._ready:
            self._info = info
            self._ready.notify()

    def _images(self) -> Generator[Image, None, None]:
        while (newest := self._next()) is not None:
            message, missed = newest
            stamp = message.header.stamp
            yield Image(int(stamp.sec) + 1e-9 * int(stamp.nanosec), missed, partial(self._read, message))

    def _next(self) -> _Newest | None:
        """Take the newest message, once its CameraInfo is there; None if the time is over."""
        until = time.monotonic() + self._settings.timeout
        with self._ready:
            while not self._complete():
                left, patience = self._left(), until - time.monotonic()
                if left <= 0.0:
                    return None
                if patience <= 0.0:
                    raise self._silence()
                self._ready.wait(min(left, patience, _PAUSE))
            newest, self._newest = self._newest, None
        return newest

    def _complete(self) -> bool:
        known = self._given is not None or self._kind == "PointCloud2" or self._info is not None
        return known and self._newest is not None

    def _silence(self) -> ConnectionLostError:
        seconds = f"within {self._settings.timeout:g} s"
        if self._newest is not None:
            own = info_topic(self._topic)
            return ConnectionLostError(
                f"{self._topic} has images, but {own} no CameraInfo {seconds}; publish it, or pass the intrinsics "
                "(--camera-info)"
            )
        return ConnectionLostError(
            f"{self._topic} has no message {seconds}; check that it is published: ros2 topic hz {self._topic}"
        )

    def _read(self, message: Any) -> Capture:
        found = found_of(message, self._topic, self.name)
        if self._given is None and found.image is not None:
            found.camera = self._camera(message)
        return self._settings.capture(found, self._given)

    def _camera(self, message: Any) -> Camera:
        own = info_topic(self._topic)
        return camera_of_info(self._info, own, self._topic, str(message.header.frame_id))
