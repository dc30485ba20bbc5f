"""Depth of ROS recordings: bags of ROS 1 and ROS 2, written here with rosbags; topics, times, cameras, encodings."""

import io
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import average, open_camera, read_capture
from graspbox.captures.messages import cloud_of, depth_of

pytest.importorskip("rosbags", reason="recordings need the extra 'recordings'")
image_module = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
from rosbags import rosbag1, rosbag2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
FRAME = "camera_depth_optical_frame"
K = [60.0, 0.0, 31.7, 0.0, 61.0, 23.4, 0.0, 0.0, 1.0]
LENS = np.array([[60.0, 0.0, 32.2], [0.0, 61.0, 23.9], [0.0, 0.0, 1.0]])


def scene(number: int = 0) -> NDArray[np.float64]:
    """Make a tilted plane (48, 64), whole millimetres, farther with each number, and pixels without a depth."""
    rows, columns = np.mgrid[:48, :64]
    depth = np.round(0.5 + 0.003 * rows + 0.001 * columns + 0.05 * number, 3)
    depth[:2, :3] = 0.0
    return np.asarray(depth, dtype=np.float64)


def millimetres(number: int = 0) -> NDArray[np.uint16]:
    return (scene(number) * 1000).round().astype(np.uint16)


class Messages:
    """Messages of one version of ROS."""

    def __init__(self, store: Any) -> None:
        self.store, self.ros1 = store, store is ROS1

    def make(self, kind: str, **values: Any) -> Any:
        """Make a message of a type."""
        return self.store.types[kind](**values)

    def header(self, frame: str = FRAME) -> Any:
        """Make the header of a frame."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=1, nanosec=0)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def image(self, values: NDArray[Any], encoding: str, frame: str = FRAME, padding: int = 0, big: int = 0) -> Any:
        """Make an Image, with bytes after each row."""
        data = values.astype(values.dtype.newbyteorder(">" if big else "<"))
        rows = np.pad(data.view(np.uint8).reshape(len(values), -1), ((0, 0), (0, padding)), constant_values=77)
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(frame),
            height=values.shape[0],
            width=values.shape[1],
            encoding=encoding,
            is_bigendian=big,
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, data: bytes, form: str) -> Any:
        """Make a CompressedImage of a format."""
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(),
            format=form,
            data=np.frombuffer(data, np.uint8),
        )

    def info(self, frame: str = FRAME, size: tuple[int, int] = (64, 48), **changes: Any) -> Any:
        """Make a CameraInfo, with other d, k, r or p."""
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        names = ("D", "K", "R", "P") if self.ros1 else ("d", "k", "r", "p")
        p = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
        numbers = {"d": [0.0] * 5, "k": K, "r": np.eye(3).ravel(), "p": p, **changes}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(frame),
            width=size[0],
            height=size[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **{name: np.array(numbers[name.lower()], dtype=np.float64) for name in names},
        )


def kind_of(message: Any) -> str:
    return str(message.__msgtype__)


def write(path: Path, topics: dict[str, list[Any]], form: str = "mcap", excess: bytes = b"") -> Path:
    """Write messages of topics, one each second from the second 100 on."""
    ros1 = form == "bag"
    if ros1:
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if form == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    store = ROS1 if ros1 else ROS2
    with writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, kind_of(messages[0]), typestore=store)
            for number, message in enumerate(messages):
                kind = kind_of(message)
                data = bytes(store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind))
                data += excess if kind == "sensor_msgs/msg/Image" else b""
                writer.write(connection, (100 + number) * 10**9, data)
    return path


@pytest.mark.parametrize("form", ["bag", "mcap", "sqlite3"])
def test_recordings_of_every_kind_are_read(form: str, tmp_path: Path) -> None:
    ros = Messages(ROS1 if form == "bag" else ROS2)
    colour = ros.image(np.zeros((48, 64), np.uint8), "mono8", "camera_color_optical_frame")
    path = write(
        tmp_path / ("depth.bag" if form == "bag" else "depth"),
        {
            "/camera/color/image_raw": [colour],
            "/camera/color/camera_info": [ros.info("camera_color_optical_frame", k=[2.0 * one for one in K[:8]] + [1])],
            "/camera/depth/image_rect_raw": [ros.image(millimetres(number), "16UC1") for number in range(3)],
            "/camera/depth/camera_info": [ros.info()],
        },
        form,
    )
    files = [path] if form == "bag" else [path, next(path.glob("*.mcap" if form == "mcap" else "*.db3"))]
    for one in files:
        seen = read_capture(one)
        np.testing.assert_allclose(seen.depth, scene(), atol=1e-9)
        np.testing.assert_allclose(seen.intrinsics, LENS)
        assert (seen.warnings, seen.source) == ((), f"/camera/depth/image_rect_raw of {one}")
        for settings, number in (({"frame": 2}, 2), ({"time": 0.0}, 0), ({"time": 0.5}, 1), ({"time": 2.0}, 2)):
            chosen = read_capture(one, topic="/camera/depth/image_rect_raw", **settings)
            np.testing.assert_allclose(chosen.depth, scene(number), atol=1e-9)
        bad: list[tuple[dict[str, Any], str]] = [
            ({"frame": 3}, "no message of the number 3 .* it has 3 of them"),
            ({"time": 2.5}, r"no message from 2\.5 s on"),
            ({"time": -1.0}, "pass 0 or more"),
            ({"time": 1.0, "frame": 1}, "pass one of them"),
            ({"topic": "/camera/color/image_raw"}, "topics with depth: /camera/depth/image_rect_raw"),
        ]
        for settings, message in bad:
            with pytest.raises(errors.ConfigError, match=message):
                read_capture(one, **settings)


def test_one_of_several_topics_is_named(tmp_path: Path) -> None:
    ros = Messages(ROS2)
    image, info = ros.image(millimetres(), "16UC1"), ros.info()
    topics = {f"/{side}/depth": [image] for side in ("left", "right")}
    path = write(tmp_path / "two", {**topics, "/left/camera_info": [info]})
    with pytest.raises(errors.ConfigError, match="choose one by --topic or topic: /left/depth, /right/depth"):
        read_capture(path)
    assert read_capture(path, topic="/left/depth").intrinsics[0, 0] == 60.0
    # The only CameraInfo of the same frame.
    assert read_capture(path, topic="/right/depth").intrinsics[0, 0] == 60.0
    path = write(tmp_path / "none", {"/left/image": [ros.image(millimetres(), "mono16")]})
    with pytest.raises(errors.ConfigError, match=r"no topic of depth images or clouds; its topics: /left/image"):
        read_capture(path)
    path = write(tmp_path / "alone", {"/depth": [image]})
    with pytest.raises(errors.ConfigError, match="has no intrinsics"):
        read_capture(path)
    np.testing.assert_allclose(read_capture(path, intrinsics=LENS).depth, scene(), atol=1e-9)


def test_the_camera_belongs_to_the_image(tmp_path: Path) -> None:
    ros = Messages(ROS2)
    bad = [0.0, *K[1:]]
    p = [70.0, *K[1:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
    cases: list[tuple[str, Any, str | float]] = [
        ("/camera/depth/image_raw", ros.info("other_frame"), "so that they belong to different cameras"),
        ("/camera/depth/image_raw", ros.info(k=bad), "is not calibrated"),
        ("/camera/depth/image_raw", ros.info(size=(128, 96)), "images of 128 x 96 pixels"),
        ("/camera/depth/image_rect", ros.info(p=[*p[:3], -5.0, *p[4:]]), "second camera of a stereo pair"),
        ("/camera/depth/image_rect", ros.info(p=p, d=[-0.3, 0, 0, 0, 0]), 70.0),
        ("/camera/aligned_depth_to_color/image_raw", ros.info(d=[-0.3, 0, 0, 0, 0]), 60.0),
    ]
    for number, (topic, info, expected) in enumerate(cases):
        topics = {topic: [ros.image(millimetres(), "16UC1")], f"{topic.rpartition('/')[0]}/camera_info": [info]}
        path = write(tmp_path / str(number), topics)
        if isinstance(expected, str):
            with pytest.raises(errors.ConfigError, match=expected):
                read_capture(path)
        else:
            seen = read_capture(path)
            assert (seen.intrinsics[0, 0], seen.warnings) == (expected, ())
            np.testing.assert_allclose(seen.depth, scene(), atol=1e-9)
    distorted = {
        "/d/image_raw": [ros.image(millimetres(), "16UC1")],
        "/d/camera_info": [ros.info(d=[-0.3, 0, 0, 0, 0])],
    }
    seen = read_capture(write(tmp_path / "distorted", distorted))
    assert "the distortion of /d/camera_info" in seen.warnings[0]


@pytest.mark.parametrize("form", ["bag", "sqlite3"])
def test_recordings_of_realsense_have_their_unit(form: str, tmp_path: Path) -> None:
    """New ones hold the unit as text, old ones as a number, and four bytes too many in each image."""
    ros = Messages(ROS1 if form == "bag" else ROS2)
    unit: Any = (
        ros.make("std_msgs/msg/Float32", data=1e-4) if form == "bag" else ros.make("std_msgs/msg/String", data="0.0001")
    )
    stream, encoding = "/device_0/sensor_0/Depth_0", "mono16" if form == "bag" else "16UC1"
    topics = {
        f"{stream}/image/data": [ros.image((scene() * 1e4).round().astype(np.uint16), encoding, "0")],
        f"{stream}/info/camera_info": [ros.info("")],
        "/device_0/sensor_0/option/Depth_Units/value": [unit],
        "/device_0/sensor_1/option/Depth_Units/value": [ros.make("std_msgs/msg/String", data="7")],
        "/device_0/sensor_0/Infrared_1/image/data": [ros.image(millimetres(), "mono16", "0")],
    }  # fmt: skip
    excess = struct.pack("<f", 1e-4) if form == "bag" else b""
    path = write(tmp_path / ("old.bag" if form == "bag" else "new"), topics, form, excess)
    seen = read_capture(path)
    np.testing.assert_allclose(seen.depth, scene(), atol=1e-9)
    assert seen.warnings == ()
    del topics["/device_0/sensor_0/option/Depth_Units/value"]
    path = write(tmp_path / ("without.bag" if form == "bag" else "without"), topics, form, excess)
    with pytest.raises(errors.ConfigError, match=r"perhaps its unit is tenths of millimetres"):
        read_capture(path)
    np.testing.assert_allclose(read_capture(path, depth_scale=1e-4).depth, scene(), atol=1e-9)
    topics[f"{stream}/image/data"] = [ros.image(millimetres(), "16UC1", "0")]
    path = write(tmp_path / ("usual.bag" if form == "bag" else "usual"), topics, form, excess)
    seen = read_capture(path)
    np.testing.assert_allclose(seen.depth, scene(), atol=1e-9)
    assert "does not state the unit" in seen.warnings[0]


def rvl(values: NDArray[np.uint16]) -> bytes:
    """Encode RVL by its definition, nibble by nibble."""
    nibbles: list[int] = []

    def put(value: int) -> None:
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | (8 if value else 0))
            if not value:
                return

    flat, at, last = values.ravel().astype(int).tolist(), 0, 0
    while at < len(flat):
        start = at
        while at < len(flat) and flat[at] == 0:
            at += 1
        put(at - start)
        start = at
        while at < len(flat) and flat[at] != 0:
            at += 1
        put(at - start)
        for value in flat[start:at]:
            change, last = value - last, value
            put(2 * change if change >= 0 else -2 * change - 1)
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{one:x}" for one in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return struct.pack("<II", values.shape[1], values.shape[0]) + struct.pack(f"<{len(words)}I", *words)


def packed_png(values: NDArray[np.uint16]) -> bytes:
    file = io.BytesIO()
    image_module.fromarray(values).save(file, format="png")
    return file.getvalue()


def test_every_encoding_is_decoded(tmp_path: Path) -> None:
    ros = Messages(ROS2)
    values, depth = millimetres(), scene()
    holes = np.where(depth > 0, depth, np.nan).astype(np.float32)
    a, b = 30.0, 5.0
    inverse = np.zeros(depth.shape, dtype=np.uint16)
    inverse[depth > 0] = np.round(a / depth[depth > 0] * 100 + b)
    config, garbage = struct.pack("<iff", 0, 100 * a, b), struct.pack("<iff", 7, float("nan"), 1e30)
    messages = [
        (ros.image(values, "16UC1", padding=6), 1e-9),
        (ros.image(values, "16UC1", big=1), 1e-9),
        (ros.image(values, "mono16"), 1e-9),
        (ros.image(holes, "32FC1", padding=4), 1e-6),
        (ros.image(holes, "32FC1", big=1), 1e-6),
        (ros.compressed(packed_png(values), "16UC1; png compressed "), 1e-9),
        (ros.compressed(garbage + packed_png(values), "16UC1; compressedDepth"), 1e-9),
        (ros.compressed(garbage + packed_png(values), "16UC1; compressedDepth png"), 1e-9),
        (ros.compressed(garbage + rvl(values), "16UC1; compressedDepth rvl"), 1e-9),
        (ros.compressed(config + packed_png(inverse), "32FC1; compressedDepth png"), 2e-4),
        (ros.compressed(config + rvl(inverse), "32FC1; compressedDepth rvl"), 2e-4),
    ]
    for number, (message, error) in enumerate(messages):
        transport = "/compressedDepth" if hasattr(message, "format") else ""
        topics = {f"/depth/image{transport}": [message], "/depth/camera_info": [ros.info()]}
        seen = read_capture(write(tmp_path / str(number), topics))
        np.testing.assert_allclose(seen.depth, depth, atol=error)
        np.testing.assert_allclose(seen.intrinsics, LENS)


def test_broken_messages_are_refused() -> None:
    ros = Messages(ROS2)
    short = ros.image(millimetres(), "16UC1")
    short.data = short.data[:-1]
    narrow = ros.image(millimetres(), "16UC1")
    narrow.width = 65
    content, head = rvl(millimetres()), bytes(12)
    larger = struct.pack("<II", 9999, 9999) + content[8:]
    for message, expected in (
        (short, "bytes for 64 x 48 pixels in rows of 128 bytes, which do not fit"),
        (narrow, "do not fit"),
        (ros.image(millimetres(), "bgr8"), "which is no depth"),
        (ros.compressed(b"", "16UC1; compressedDepth"), "it holds nothing"),
        (ros.compressed(bytes(40), "16UC1; compressedDepth png"), "no 16-bit PNG of one channel"),
        (ros.compressed(packed_png(millimetres())[:-60], "16UC1; png compressed"), "broken PNG"),
        (ros.compressed(head + content[:-8], "16UC1; compressedDepth rvl"), "broken RVL"),
        (ros.compressed(head + larger, "16UC1; compressedDepth rvl"), "broken RVL"),
        (ros.compressed(b"\xff\xd8\xff", "rgb8; jpeg compressed bgr8"), "which is no depth"),
    ):  # fmt: skip
        with pytest.raises(errors.ConfigError, match=expected):
            depth_of(message, "/depth")


def cloud(points: NDArray[np.float64], order: str = "<") -> SimpleNamespace:
    """Make a PointCloud2 of points (H, W, 3) with fields out of order, padded points and rows."""
    rows, columns, _ = points.shape
    kind = np.dtype({"names": ["z", "x", "y"], "formats": [order + "f4"] * 3, "offsets": [4, 12, 8], "itemsize": 24})
    packed = np.zeros((rows, columns), kind)
    for axis, name in enumerate("xyz"):
        packed[name] = points[..., axis]
    data = np.pad(packed.view(np.uint8).reshape(rows, -1), ((0, 0), (0, 16)))
    fields = [SimpleNamespace(name=name, offset=kind.fields[name][1], datatype=7, count=1) for name in "zxy"]  # type: ignore[index]
    sizes = {"height": rows, "width": columns, "point_step": 24, "row_step": data.shape[1]}
    return SimpleNamespace(**sizes, fields=fields, is_bigendian=order == ">", is_dense=False, data=data.ravel())


def test_clouds_are_read_by_their_offsets(tmp_path: Path) -> None:
    depth = scene()
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    points = np.stack([(u - 32.2) / 60 * depth, (v - 23.9) / 61 * depth, depth], axis=-1)
    points[depth == 0] = np.nan
    for order in "<>":
        np.testing.assert_allclose(cloud_of(cloud(points, order), "/points"), points, atol=1e-6)
    broken = cloud(points)
    broken.data = broken.data[:-1]
    with pytest.raises(errors.ConfigError, match="which do not fit"):
        cloud_of(broken, "/points")
    ros, made = Messages(ROS2), cloud(points)
    fields = [ros.make("sensor_msgs/msg/PointField", **vars(one)) for one in made.fields]
    message = ros.make("sensor_msgs/msg/PointCloud2", header=ros.header(), **{**vars(made), "fields": fields})
    seen = read_capture(write(tmp_path / "cloud", {"/camera/points": [message]}))
    np.testing.assert_allclose(seen.depth, depth, atol=1e-6)
    np.testing.assert_allclose(seen.intrinsics, LENS, atol=1e-3)
    assert f"their frame is '{FRAME}'" in seen.warnings[0]


@pytest.mark.parametrize("form", ["bag", "mcap", "sqlite3"])
def test_a_broken_recording_is_an_error(form: str, tmp_path: Path) -> None:
    ros = Messages(ROS1 if form == "bag" else ROS2)
    topics = {"/depth/image": [ros.image(millimetres(), "16UC1")], "/depth/camera_info": [ros.info()]}
    path = write(tmp_path / ("depth.bag" if form == "bag" else "depth"), topics, form)
    file = path if form == "bag" else next(path.glob("*.mcap" if form == "mcap" else "*.db3"))
    content = file.read_bytes()
    rng = np.random.default_rng(0)
    broken = tmp_path / f"broken{file.suffix}"
    for _ in range(25):
        changed = bytearray(content[: rng.integers(20, len(content))] if rng.random() < 0.5 else content)
        for place in rng.integers(16, len(changed), size=3):
            changed[place] = rng.integers(256)
        broken.write_bytes(changed)
        try:
            assert read_capture(broken).depth.shape == (48, 64)
        except (errors.ConfigError, errors.FileError):
            continue


def fastwrite(path: Path, topics: dict[str, list[Any]]) -> Path:
    """Write an MCAP file without chunks and index, as the storage preset "fastwrite" of ROS 2 does."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(opcode: int, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    parts = [record(1, text("ros2") + text("test"))]
    messages = []
    for number, (topic, own) in enumerate(topics.items(), 1):
        kind = own[0].__msgtype__
        definition = ROS2.generate_msgdef(kind, ros_version=2)[0].encode()
        schema = struct.pack("<H", number) + text(kind) + text("ros2msg")
        parts.append(record(3, schema + struct.pack("<I", len(definition)) + definition))
        parts.append(record(4, struct.pack("<HH", number, number) + text(topic) + text("cdr") + struct.pack("<I", 0)))
        messages += [(second, number, bytes(ROS2.serialize_cdr(message, kind))) for second, message in enumerate(own)]
    for second, number, data in sorted(messages, key=lambda one: one[:2]):
        times = (second * 10**9, second * 10**9)
        parts.append(record(5, struct.pack("<HIQQ", number, second, *times) + data))
    parts += [record(15, bytes(4)), record(2, bytes(20))]
    path.write_bytes(b"\x89MCAP0\r\n" + b"".join(parts) + b"\x89MCAP0\r\n")
    return path


def test_recordings_without_chunks_are_complete(tmp_path: Path) -> None:
    """A loop of rosbags over such a file ends as soon as another topic is read."""
    ros, names = Messages(ROS2), ("/camera/depth/image_rect_raw", "/camera/depth/camera_info")
    images = [ros.image(millimetres(number), "16UC1") for number in range(5)]
    path = fastwrite(tmp_path / "fast.mcap", {names[0]: images, names[1]: [ros.info() for _ in images]})
    with open_camera(path) as source:
        seen = [frame.capture for frame in source]
    assert len(seen) == 5
    for number, capture in enumerate(seen):
        np.testing.assert_allclose(capture.depth, scene(number), atol=1e-9)
        np.testing.assert_array_equal(read_capture(path, frame=number).depth, capture.depth)
        np.testing.assert_array_equal(read_capture(path, time=float(number)).depth, capture.depth)
    assert read_capture(path, frames=5).depth.shape == (48, 64)
    for wrong in ({"time": -1.0}, {"frame": -1}):
        with pytest.raises(errors.ConfigError, match="does not exist; pass 0 or more"):
            read_capture(path, frames=2, **wrong)


def test_images_of_a_recording_are_averaged(tmp_path: Path) -> None:
    ros, names = Messages(ROS2), ("/camera/depth/image_rect_raw", "/camera/depth/camera_info")
    noise = np.random.default_rng(0).integers(-8, 9, (20, 48, 64))
    images = [ros.image((millimetres() + (noise[i] if i else 500)).astype(np.uint16), "16UC1") for i in range(20)]
    path = write(tmp_path / "bag", {names[0]: images, names[1]: [ros.info()]})
    one, several = read_capture(path, frame=1), read_capture(path, time=1.0, frames=19)
    measured = scene() > 0
    errors_of = [np.abs(seen.depth - scene())[measured].mean() for seen in (one, several)]
    assert errors_of[1] < 0.4 * errors_of[0]
    np.testing.assert_array_equal(several.depth, read_capture(path, frame=1, frames=19).depth)
    for frames, message in ((0, "there are 0 images to average; pass 1 to 120"), (99, "has 20 images from there")):
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path, frames=frames)
    np.save(tmp_path / "depth.npy", scene())
    with pytest.raises(errors.ConfigError, match="is no recording; frames are averaged of one"):
        read_capture(tmp_path / "depth.npy", intrinsics=LENS, frames=2)
    # A pixel that half of the images measured is measured.
    holes = [read_capture(path, frame=number) for number in (1, 2, 3)]
    for seen in holes[:2]:
        seen.depth[20, 20] = 0.0
    assert average(holes).depth[20, 20] == 0.0
    holes[0].depth[20, 20] = 0.6
    assert 0.5 < average(holes).depth[20, 20] < 0.7
    with pytest.raises(errors.ConfigError, match="there are 0 images to average"):
        average([])
    moved = replace(holes[1], table_from_camera=np.eye(4))
    with pytest.raises(errors.ConfigError, match="has another pose of the camera"):
        average([holes[0], moved])
    odd = np.arange(64) % 2 == 1
    halves = [replace(one, depth=np.where(own, one.depth, 0.0)) for own, one in zip((odd, ~odd), holes, strict=False)]
    with pytest.raises(errors.ConfigError, match="no pixel is measured in half of the images"):
        average(halves)
    np.save(tmp_path / "other.npy", scene()[:40])
    with pytest.raises(errors.ConfigError, match="pass images of one camera"):
        average([*holes, read_capture(tmp_path / "other.npy", intrinsics=LENS)])
