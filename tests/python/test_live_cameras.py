"""Live sources: a growing folder, recordings played, RealSense and ROS 2.

No camera is connected and no ROS is installed here: stand-ins of the modules pyrealsense2 and rclpy, with the names,
arguments and results of their interfaces that `graspbox.captures.live` uses, take their places.
"""

import json
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import Frame, open_camera, read_capture

LENS = np.array([[60.0, 0.0, 32.2], [0.0, 61.0, 23.9], [0.0, 0.0, 1.0]])
K = [60.0, 0.0, 31.7, 0.0, 61.0, 23.4, 0.0, 0.0, 1.0]
FRAME = "camera_depth_optical_frame"
#: Seconds after which a test that waits fails.
PATIENCE = 60.0


def scene(number: int = 0) -> NDArray[np.float64]:
    """Make a tilted plane (48, 64), whole millimetres, farther with each number."""
    rows, columns = np.mgrid[:48, :64]
    return np.asarray(np.round(0.5 + 0.003 * rows + 0.001 * columns + 0.05 * number, 3))


def millimetres(number: int = 0) -> NDArray[np.uint16]:
    return (scene(number) * 1000).round().astype(np.uint16)


def numbers(frames: list[Frame]) -> list[int]:
    """Return the numbers of the scenes that frames show."""
    return [round((frame.capture.depth[-1, -1] - scene()[-1, -1]) / 0.05) for frame in frames]


def taken(source: Any, count: int) -> list[Frame]:
    return list(islice(iter(source), count))


def test_files_are_read_once_in_their_order(tmp_path: Path) -> None:
    for number, name in enumerate(("c.npy", "a.npy", "b.npy")):
        np.save(tmp_path / name, scene(number))
        # The last two have the same time, so that their names decide.
        os.utime(tmp_path / name, ns=(10**18, 10**18 + min(number, 1) * 10**9))
    for ignored in (".hidden.npy", "notes.txt", "picture.jpg", "colour_labels.png", "mask.npy"):
        (tmp_path / ignored).write_bytes(b"nothing")
    with open_camera(tmp_path, intrinsics=LENS, seconds=2.0) as source:
        frames = list(source)
    assert numbers(frames) == [0, 1, 2]
    assert [(frame.index, frame.skipped, frame.time) for frame in frames] == [
        (0, 0, 1e9),
        (1, 0, 1e9 + 1),
        (2, 0, 1e9 + 1),
    ]
    assert frames[0].capture.source == str(tmp_path / "c.npy")
    np.testing.assert_array_equal(frames[0].capture.depth, scene())


def test_a_growing_file_is_read_when_it_is_complete(tmp_path: Path) -> None:
    content = tmp_path / "content"
    with content.open("wb") as file:
        np.save(file, scene(1))
    data, target = content.read_bytes(), tmp_path / "seen" / "grows.npy"
    target.parent.mkdir()
    np.save(target.with_name("first.npy"), scene(0))

    def write() -> None:
        with target.open("wb", buffering=0) as file:
            for start in range(0, len(data), len(data) // 8):
                file.write(data[start : start + len(data) // 8])
                time.sleep(0.04)
        np.save(target.with_name(".last.npy"), scene(2))
        target.with_name(".last.npy").rename(target.with_name("last.npy"))

    with open_camera(target.parent, intrinsics=LENS, seconds=PATIENCE) as source:
        thread = threading.Thread(target=write)
        thread.start()
        frames = taken(source, 3)
        thread.join()
    assert numbers(frames) == [0, 1, 2]


def test_files_of_before_are_left_out(tmp_path: Path) -> None:
    np.save(tmp_path / "old.npy", scene(0))
    with open_camera(tmp_path, intrinsics=LENS, new_only=True, seconds=PATIENCE) as source:
        np.save(tmp_path / "new.npy", scene(4))
        assert numbers(taken(source, 1)) == [4]


def test_a_file_that_cannot_be_read_is_skipped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "a.npy").write_bytes(b"no array")
    np.save(tmp_path / "b.npy", scene(1))
    with open_camera(tmp_path, intrinsics=LENS, seconds=PATIENCE) as source, caplog.at_level(logging.WARNING):
        frames = iter(source)
        first = next(frames)
        assert (numbers([first]), first.index, first.skipped, source.skipped) == ([1], 1, 1, 1)
        assert "a.npy is not an array written by numpy.save" in caplog.text
        assert "a.npy" in source.refusal
        # Files are read again when they change.
        np.save(tmp_path / "a.npy", scene(3))
        np.save(tmp_path / "b.npy", scene(5))
        np.save(tmp_path / "c.npy", scene(2))
        rest = [next(frames), next(frames), next(frames)]
    assert sorted(numbers(rest)) == [2, 3, 5]


def test_camera_files_and_labels_of_the_folder_are_used(tmp_path: Path) -> None:
    pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    from PIL import Image

    (tmp_path / "camera.json").write_text(json.dumps({"width": 64, "height": 48, "k": K}))
    marks = np.zeros((48, 64), np.uint8)
    marks[10:20, 10:20], marks[30:40, 30:40] = 3, 7
    Image.fromarray(marks).save(tmp_path / "a_labels.png")
    np.save(tmp_path / "b_mask.npy", marks == 7)
    for number, name in enumerate("abc"):
        Image.fromarray(millimetres(number)).save(tmp_path / f"{name}.png")
    with open_camera(tmp_path, seconds=PATIENCE) as source:
        labelled, masked, plain = sorted(taken(source, 3), key=lambda frame: frame.capture.source)
    np.testing.assert_allclose(labelled.capture.intrinsics, LENS)
    np.testing.assert_array_equal(labelled.capture.labels, marks)
    np.testing.assert_array_equal(masked.capture.mask(), marks == 7)
    assert plain.capture.labels is None


def test_a_folder_without_intrinsics_says_so(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", scene())
    with open_camera(tmp_path, seconds=2.0) as source:
        assert list(source) == []
        assert "a.npy has no intrinsics" in source.refusal


def test_a_folder_that_vanishes_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    with open_camera(tmp_path / "gone", intrinsics=LENS) as source:
        (tmp_path / "gone").rmdir()
        with pytest.raises(errors.FileError, match="gone"):
            next(iter(source))


def test_a_closed_source_ends(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", scene())
    source = open_camera(tmp_path, intrinsics=LENS)
    frames = iter(source)
    next(frames)
    source.close()
    assert list(frames) == []


def test_wrong_sources_and_arguments_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", scene())
    cases: list[tuple[Any, dict[str, Any], str]] = [
        (tmp_path / "none", {}, "there is no such source; name a folder, realsense"),
        (tmp_path / "a.npy", {}, "is one file; name a folder"),
        (tmp_path, {"topic": "/depth"}, "is no recording, of which topic"),
        (tmp_path, {"limits": (2.0, 1.0)}, "limits are"),
        (tmp_path, {"depth_scale": -1.0}, "depth_scale is -1"),
        (tmp_path, {"seconds": 0.0}, "seconds is 0"),
        (tmp_path, {"intrinsics": tmp_path / "k.json"}, "no such file of intrinsics"),
        ("realsense", {"new_only": True}, "is no folder of images"),
        ("ros2:depth", {}, "names no topic; write it as ros2:/camera"),
    ]
    for source, settings, message in cases:
        with pytest.raises((errors.ConfigError, errors.FileError), match=message):
            open_camera(source, **settings)


def test_recordings_are_played(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="recordings need the extra 'recordings'")
    pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    from test_capture_recordings import ROS1, ROS2, Messages, millimetres, write

    for form in ("bag", "mcap", "sqlite3"):
        ros = Messages(ROS1 if form == "bag" else ROS2)
        images = [ros.image(millimetres(number), "16UC1") for number in range(4)]
        images[2].width += 1
        topics = {
            "/camera/depth/image_rect_raw": images,
            "/camera/depth/camera_info": [ros.info() for _ in range(4)],
            "/other/depth": [ros.image(millimetres(9), "16UC1")],
        }
        path = write(tmp_path / ("depth.bag" if form == "bag" else form), topics, form)
        with pytest.raises(errors.ConfigError, match="several topics with depth"), open_camera(path) as source:
            next(iter(source))
        with open_camera(path, topic="/camera/depth/image_rect_raw") as source:
            frames = list(source)
        assert [(frame.index, frame.skipped, frame.time) for frame in frames] == [
            (0, 0, 100.0),
            (1, 0, 101.0),
            (3, 1, 103.0),
        ]
        assert "which do not fit" in source.refusal
        for frame in frames:
            same = read_capture(path, topic="/camera/depth/image_rect_raw", frame=frame.index)
            np.testing.assert_array_equal(frame.capture.depth, same.depth)
            np.testing.assert_array_equal(frame.capture.intrinsics, same.intrinsics)
            assert (frame.capture.source, frame.capture.warnings) == (same.source, same.warnings)


class Depth:
    """A depth_frame of pyrealsense2, whose data are those of a buffer that the SDK uses again."""

    def __init__(self, number: int, buffer: NDArray[np.uint16]) -> None:
        self.number, self.buffer = number, buffer
        lens = SimpleNamespace(
            width=64,
            height=48,
            fx=60.0,
            fy=61.0,
            ppx=31.7,
            ppy=23.4,
            coeffs=[0.0] * 5,
            model="distortion.brown_conrady",
        )
        self.profile = SimpleNamespace(as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: lens))

    def __bool__(self) -> bool:
        return self.number >= 0

    def get_data(self) -> memoryview:
        """Fill the buffer with tenths of millimetres."""
        self.buffer[:] = (scene(self.number) * 1e4).round()
        return self.buffer.data

    def get_units(self) -> float:
        """Return metres per unit, a float32."""
        return float(np.float32(1e-4))

    def get_timestamp(self) -> float:
        """Return milliseconds."""
        return 1e3 * (1000 + self.number)

    def get_frame_number(self) -> int:
        """Return the number that the camera counts."""
        return self.number


class RealSense:
    """What a test wants of the stand-in, and what it was asked."""

    def __init__(self) -> None:
        self.frames: list[int | Exception | None] = []
        self.serial, self.streams, self.running = "", list[tuple[Any, ...]](), False
        self.buffer = np.zeros((48, 64), np.uint16)

    def start(self, config: Any) -> None:
        """Start the camera of the serial number, if it is connected."""
        if self.serial not in ("", "842512070190"):
            raise RuntimeError("No device connected")
        self.running = True

    def stop(self) -> None:
        """Stop the camera."""
        if not self.running:
            raise RuntimeError("stop() cannot be called before start()")
        self.running = False

    def wait(self, timeout_ms: int = 5000) -> tuple[bool, Any]:
        """Return the next frame; None is a frameset without depth."""
        assert isinstance(timeout_ms, int)
        if not self.frames:
            time.sleep(timeout_ms / 1e3)
            return False, SimpleNamespace()
        found = self.frames.pop(0)
        if isinstance(found, Exception):
            raise found
        return True, SimpleNamespace(get_depth_frame=lambda: Depth(-1 if found is None else found, self.buffer))

    def module(self) -> ModuleType:
        """Make the module."""
        made = ModuleType("pyrealsense2")
        device = SimpleNamespace(get_info={"serial_number": "842512070190"}.__getitem__)
        config = SimpleNamespace(
            enable_device=lambda serial: setattr(self, "serial", serial),
            enable_stream=lambda *words: self.streams.append(words),
        )
        made.__dict__.update(
            pipeline=lambda: SimpleNamespace(start=self.start, stop=self.stop, try_wait_for_frames=self.wait),
            config=lambda: config,
            context=lambda: SimpleNamespace(query_devices=lambda: [device]),
            stream=SimpleNamespace(depth="depth"),
            format=SimpleNamespace(z16="z16"),
            camera_info=SimpleNamespace(serial_number="serial_number"),
        )
        return made


@pytest.fixture
def realsense(monkeypatch: pytest.MonkeyPatch) -> RealSense:
    camera = RealSense()
    monkeypatch.setitem(sys.modules, "pyrealsense2", camera.module())
    return camera


def test_realsense_frames_have_unit_and_lens(realsense: RealSense) -> None:
    realsense.frames = [7, None, 8, 12]
    with open_camera("realsense:842512070190") as source:
        frames = taken(source, 3)
        assert realsense.running
    assert not realsense.running
    assert (realsense.serial, realsense.streams) == ("842512070190", [("depth", "z16")])
    assert numbers(frames) == [7, 8, 12]
    assert [(frame.index, frame.skipped, frame.time) for frame in frames] == [
        (0, 0, 1007.0),
        (1, 0, 1008.0),
        (5, 3, 1012.0),
    ]
    np.testing.assert_allclose(frames[0].capture.depth, scene(7), atol=1e-9)
    np.testing.assert_allclose(frames[0].capture.intrinsics, LENS)
    realsense.frames = [1]
    with open_camera("realsense", intrinsics=LENS * [[70 / 60], [1], [1]], seconds=0.3) as source:
        assert [frame.capture.intrinsics[0, 0] for frame in source] == [70.0]


def test_a_silent_or_lost_realsense_is_an_error(realsense: RealSense) -> None:
    with pytest.raises(errors.ConnectionLostError, match=r"connected cameras: 842512070190\. Check the cable"):
        open_camera("realsense:1")
    realsense.serial = ""
    with (
        open_camera("realsense", timeout=0.2) as source,
        pytest.raises(errors.ConnectionLostError, match=r"sent no depth within 0\.2 s; check the cable"),
    ):
        next(iter(source))
    realsense.frames = [1, RuntimeError("Device disconnected")]
    with open_camera("realsense") as source:
        frames = iter(source)
        next(frames)
        with pytest.raises(errors.ConnectionLostError, match=r"is lost \(Device disconnected\)"):
            next(frames)


class Ros:
    """A stand-in of rclpy and sensor_msgs; topics by name, with their types."""

    def __init__(self, topics: dict[str, str]) -> None:
        self.topics, self.taking = topics, dict[str, Callable[[Any], None]]()
        self.live, self.profiles = 0, set[str]()
        self._stop = threading.Event()

    def publish(self, topic: str, message: Any) -> None:
        """Send a message to the subscription."""
        self.taking[topic](message)

    def node(self, name: str, *, context: Any = None) -> Any:
        """Make a node."""
        self.live += 1

        def subscribe(kind: type, topic: str, callback: Callable[[Any], None], qos_profile: Any) -> None:
            assert kind.__name__ == self.topics[topic].rpartition("/")[2]
            self.taking[topic] = callback
            self.profiles.add(qos_profile)

        def destroy() -> None:
            self.live -= 1

        listed = [(topic, [kind]) for topic, kind in self.topics.items()]
        return SimpleNamespace(
            create_subscription=subscribe, get_topic_names_and_types=lambda: listed, destroy_node=destroy
        )

    def modules(self) -> dict[str, ModuleType]:
        """Make the modules."""
        names = ("rclpy", "rclpy.executors", "rclpy.qos", "sensor_msgs", "sensor_msgs.msg")
        made = {name: ModuleType(name) for name in names}
        context = SimpleNamespace(try_shutdown=lambda: None)
        made["rclpy"].__dict__.update(Context=lambda: context, init=lambda *, context: None, create_node=self.node)
        executor = SimpleNamespace(add_node=lambda node: True, spin=self._stop.wait, shutdown=self._stop.set)
        made["rclpy.executors"].__dict__["SingleThreadedExecutor"] = lambda *, context: executor
        made["rclpy.qos"].__dict__["qos_profile_sensor_data"] = "sensor data"
        for name in ("Image", "CompressedImage", "PointCloud2", "CameraInfo"):
            made["sensor_msgs.msg"].__dict__[name] = type(name, (), {})
        return made


def header(second: int, frame: str = FRAME) -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=second, nanosec=500_000_000), frame_id=frame)


def image(number: int) -> SimpleNamespace:
    data = millimetres(number).astype("<u2").tobytes()
    size = {"height": 48, "width": 64, "step": 128, "is_bigendian": 0, "encoding": "16UC1"}
    return SimpleNamespace(header=header(number), data=data, **size)


def info(frame: str = FRAME) -> SimpleNamespace:
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    sizes = {"width": 64, "height": 48, "binning_x": 0, "binning_y": 0}
    p = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
    return SimpleNamespace(header=header(0, frame), k=K, d=[], p=p, roi=roi, distortion_model="plumb_bob", **sizes)


TOPICS = {
    "/camera/depth/image_raw": "sensor_msgs/msg/Image",
    "/camera/depth/image_raw/compressedDepth": "sensor_msgs/msg/CompressedImage",
    "/camera/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/points": "sensor_msgs/msg/PointCloud2",
    "/chatter": "std_msgs/msg/String",
}


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    made = Ros(TOPICS)
    for name, module in made.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    yield made
    assert made.live == 0


def test_the_newest_message_of_a_topic_is_taken(ros: Ros) -> None:
    topic, own = "/camera/depth/image_raw", "/camera/depth/camera_info"
    with open_camera(f"ros2:{topic}") as source:
        assert ros.profiles == {"sensor data"}
        ros.publish(topic, image(0))
        threading.Timer(0.1, ros.publish, (own, info())).start()
        frames = iter(source)
        first = next(frames)
        for number in (1, 2, 3):
            ros.publish(topic, image(number))
        second = next(frames)
    assert numbers([first, second]) == [0, 3]
    assert [(frame.index, frame.skipped, frame.time) for frame in (first, second)] == [(0, 0, 0.5), (3, 2, 3.5)]
    np.testing.assert_allclose(second.capture.intrinsics, LENS)
    assert second.capture.source == f"ros2:{topic}"


def test_compressed_images_and_clouds_of_topics_are_read(ros: Ros) -> None:
    pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    pytest.importorskip("rosbags", reason="the helpers of recordings need the extra 'recordings'")
    from test_capture_recordings import cloud, packed_png

    topic = "/camera/depth/image_raw/compressedDepth"
    with open_camera(f"ros2:{topic}") as source:
        data, form = bytes(12) + packed_png(millimetres(2)), "16UC1; compressedDepth png"
        ros.publish(topic, SimpleNamespace(header=header(1), format=form, data=data))
        ros.publish("/camera/depth/camera_info", info())
        assert numbers(taken(source, 1)) == [2]
    depth = scene(1)
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    points = np.stack([(u - 32.2) / 60 * depth, (v - 23.9) / 61 * depth, depth], axis=-1)
    with open_camera("ros2:/camera/points") as source:
        message = cloud(points)
        message.header = header(4)
        ros.publish("/camera/points", message)
        (frame,) = taken(source, 1)
    np.testing.assert_allclose(frame.capture.depth, depth, atol=1e-6)
    assert f"their frame is '{FRAME}'" in frame.capture.warnings[0]


def test_silent_topics_are_errors(ros: Ros, caplog: pytest.LogCaptureFixture) -> None:
    topic = "/camera/depth/image_raw"
    with pytest.raises(errors.ConfigError, match=r"/chatter has messages of std_msgs/msg/String; name a topic"):
        open_camera("ros2:/chatter")
    with pytest.raises(errors.ConnectionLostError, match="nobody publishes /none; topics: /camera/depth/camera_info, "):
        open_camera("ros2:/none", timeout=0.1)
    with open_camera(f"ros2:{topic}", timeout=0.2) as source:
        with pytest.raises(errors.ConnectionLostError, match=r"has no message within 0\.2 s; .* ros2 topic hz"):
            next(iter(source))
        ros.publish(topic, image(0))
        with pytest.raises(errors.ConnectionLostError, match="camera_info no CameraInfo within"):
            next(iter(source))
    with open_camera(f"ros2:{topic}", intrinsics=LENS) as source:
        ros.publish(topic, image(1))
        assert numbers(taken(source, 1)) == [1]
    with open_camera(f"ros2:{topic}", seconds=0.3) as source, caplog.at_level(logging.WARNING):
        ros.publish(topic, image(0))
        ros.publish("/camera/depth/camera_info", info("another_frame"))
        assert list(source) == []
        assert "belong to different cameras" in caplog.text


def test_missing_modules_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, source, advice in (
        ("pyrealsense2", "realsense", "pip install pyrealsense2"),
        ("rclpy", "ros2:/depth", "comes with ROS 2, not with pip: source its setup file"),
    ):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(errors.MissingExtraError, match=advice):
            open_camera(source)
