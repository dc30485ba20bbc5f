"""Depth images and clouds of ROS messages, by attribute: the same for ROS 1, ROS 2 and recordings.

Formats: sensor_msgs (Image, CompressedImage, PointCloud2); compressed_depth_image_transport (12 bytes before the
data, of which two numbers give inverse depths); RVL: Andrew D. Wilson, "Fast lossless depth image compression",
ISS 2017.
"""

import io
import struct
import warnings
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.captures.cameras import camera_of
from graspbox.captures.capture import Camera, Found
from graspbox.captures.clouds import MOST_POINTS
from graspbox.captures.images import MOST_PIXELS
from graspbox.errors import ConfigError

__all__ = ["camera_of_info", "cloud_of", "depth_of", "encoding_of", "found_of", "info_topic", "is_depth"]

_FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
#: Bytes before the data of a compressed depth image: a format and two float32.
_CONFIG = 12
#: Suffixes of topics that name the transport, not the image.
_TRANSPORTS = ("compresseddepth", "compressed", "image_transport")


def encoding_of(message: Any) -> str:
    """Return the encoding of an Image or the format of a CompressedImage."""
    return str(getattr(message, "encoding", getattr(message, "format", "")))


def is_depth(encoding: str, topic: str) -> bool:
    """Tell whether a message of an encoding holds depth; 16-bit grey does if the topic says so."""
    plain = encoding.strip().lower()
    if "compresseddepth" in plain or plain.partition(";")[0].strip() in ("16uc1", "32fc1"):
        return True
    return plain.partition(";")[0].strip() == "mono16" and "depth" in topic.lower()


def depth_of(message: Any, name: str) -> NDArray[np.generic]:
    """Return the depths (H, W) of a message: integers in its unit, or floats in metres.

    Raises
    ------
    ConfigError
        If its encoding is not that of a depth image, or the data do not fit it.
    """
    return _raw(message, name) if hasattr(message, "encoding") else _compressed(message, name)


def _raw(message: Any, name: str) -> NDArray[np.generic]:
    encoding = str(message.encoding).strip().lower()
    kind = {"16uc1": "u2", "mono16": "u2", "32fc1": "f4"}.get(encoding)
    if kind is None:
        raise ConfigError(f"{name} has images of {message.encoding!r}, which is no depth; pass a topic of depth images")
    rows, columns, step = int(message.height), int(message.width), int(message.step)
    item = np.dtype((">" if message.is_bigendian else "<") + kind)
    data = bytes(message.data)
    if not 0 < rows * columns <= MOST_PIXELS or step < columns * item.itemsize or len(data) != rows * step:
        raise ConfigError(
            f"{name} has {len(data)} bytes for {columns} x {rows} pixels in rows of {step} bytes, which do not fit"
        )
    padded = np.frombuffer(data, np.uint8).reshape(rows, step)
    return np.ascontiguousarray(padded[:, : columns * item.itemsize]).view(item)


def _compressed(message: Any, name: str) -> NDArray[np.generic]:
    words = str(message.format).strip().lower()
    encoding, data = words.partition(";")[0].strip(), bytes(message.data)
    if not is_depth(words, name):
        raise ConfigError(f"{name} has images of {message.format!r}, which is no depth; pass a topic of depth images")
    if "compresseddepth" not in words:
        return _png(data, name)
    if len(data) <= _CONFIG:
        raise ConfigError(f"{name} has a compressed image of {len(data)} bytes; it holds nothing")
    _, a, b = struct.unpack("<iff", data[:_CONFIG])
    raw: NDArray[Any] = _rvl(data[_CONFIG:], name) if "rvl" in words else _png(data[_CONFIG:], name)
    if encoding != "32fc1":
        return raw
    with np.errstate(all="ignore"):
        # Inverse depths; a and b are those of the encoder.
        return np.where(raw > 0, a / (raw.astype(np.float64) - b), 0.0)


def _png(data: bytes, name: str) -> NDArray[np.generic]:
    pillow = imported("PIL.Image", "PNG images need Pillow, from the extra 'cli'", "cli")
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[24:26] != b"\x10\0":
        raise ConfigError(f"{name} has a compressed image that is no 16-bit PNG of one channel; record the raw images")
    columns, rows = struct.unpack(">II", data[16:24])
    if columns * rows > MOST_PIXELS:
        raise ConfigError(f"{name} has more than {MOST_PIXELS} pixels; record smaller images")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with pillow.open(io.BytesIO(data), formats=("PNG",)) as image:
                values: NDArray[np.generic] = np.asarray(image)
    except Exception as error:  # Pillow raises many kinds for broken files
        raise ConfigError(f"{name} has a broken PNG: {error}") from None
    return values


def _rvl(data: bytes, name: str) -> NDArray[np.uint16]:
    """Decode RVL after columns and rows: runs of zeros and of differences, each number of 3 bits per nibble."""
    broken = ConfigError(f"{name} has a broken RVL image; record the raw images")
    if len(data) < 8:
        raise broken
    columns, rows = struct.unpack("<II", data[:8])
    size = columns * rows
    words = np.frombuffer(data, "<u4", (len(data) - 8) // 4, 8)
    # A run of zeros costs at most 11 nibbles, so that few bytes may promise many pixels.
    if not 0 < size <= MOST_PIXELS or not len(words):
        raise broken
    nibbles = (words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)).ravel() & 15
    ends = np.flatnonzero(nibbles < 8)
    firsts = np.concatenate([[0], ends[:-1] + 1])
    return _runs(_values(nibbles, firsts, ends), size, broken).reshape(rows, columns)


def _values(nibbles: NDArray[np.integer], firsts: NDArray[np.int64], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of a stream of nibbles; the lowest 3 bits come first."""
    if not len(ends):
        return np.zeros(0, dtype=np.int64)
    used = nibbles[: ends[-1] + 1].astype(np.int64) & 7
    place = np.arange(len(used)) - np.repeat(firsts, ends - firsts + 1)
    return np.add.reduceat(np.where(place < 11, used << np.minimum(3 * place, 30), 0), firsts)


def _runs(values: NDArray[np.int64], size: int, broken: ConfigError) -> NDArray[np.uint16]:
    image = np.zeros(size, dtype=np.uint16)
    at, done, last = 0, 0, 0
    while done < size:
        if at >= len(values):
            raise broken
        done += int(values[at])
        # An image may end with zeros.
        number = int(values[at + 1]) if at + 1 < len(values) else 0
        at += 2
        if done + number > size or at + number > len(values) or (done < size and number == 0 and at >= len(values)):
            raise broken
        codes = values[at : at + number]
        run = last + np.cumsum((codes >> 1) ^ -(codes & 1))
        image[done : done + number] = (run & 0xFFFF).astype(np.uint16)
        last = int(run[-1]) if number else last
        at, done = at + number, done + number
    return image


def cloud_of(message: Any, name: str) -> NDArray[np.float64]:
    """Return the points (n, 3), or (H, W, 3) if organised, of a PointCloud2; coordinates may be NaN.

    Raises
    ------
    ConfigError
        If it has no x, y and z, or its data do not fit its sizes.
    """
    fields = {str(one.name): one for one in message.fields}
    rows, columns = int(message.height), int(message.width)
    step, row_step, data = int(message.point_step), int(message.row_step), bytes(message.data)
    order = ">" if message.is_bigendian else "<"
    try:
        formats = [order + _FIELD_TYPES[int(fields[axis].datatype)] for axis in "xyz"]
        offsets = [int(fields[axis].offset) for axis in "xyz"]
        kind = np.dtype({"names": list("xyz"), "formats": formats, "offsets": offsets, "itemsize": step})
    except (KeyError, ValueError, TypeError, OverflowError):
        raise ConfigError(f"{name} has the fields {', '.join(fields)}; pass a cloud with x, y and z") from None
    if not 0 < rows * columns <= MOST_POINTS or row_step < columns * step or len(data) < rows * row_step:
        raise ConfigError(f"{name} has {len(data)} bytes for {columns} x {rows} points, which do not fit")
    padded = np.frombuffer(data, np.uint8, rows * row_step).reshape(rows, row_step)
    points = np.ascontiguousarray(padded[:, : columns * step]).view(kind)
    cloud = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    return cloud if rows > 1 else cloud[0]


def found_of(message: Any, topic: str, name: str) -> Found:
    """Return the depth image of an Image or CompressedImage, or the points of a PointCloud2, without the camera.

    Raises
    ------
    ConfigError
        As `depth_of` and `cloud_of`, which call the message `name`.
    """
    if not hasattr(message, "point_step"):
        return Found(name, image=depth_of(message, name))
    found = Found(name, points=cloud_of(message, name))
    found.warnings.append(f"the points of {topic} are taken as in the frame of a camera (x right, y down, z forward); "
                          f"their frame is {str(message.header.frame_id)!r}")  # fmt: skip
    return found


def _base(topic: str) -> PurePosixPath:
    """Return a topic without its transport."""
    path = PurePosixPath(topic)
    return path.parent if path.name.lower() in _TRANSPORTS else path


def info_topic(topic: str) -> str:
    """Return the topic of the CameraInfo beside an image topic."""
    return str(_base(topic).parent / "camera_info")


def camera_of_info(info: Any, own: str, topic: str, frame_id: str | None, of: str = "") -> Camera:
    """Return the camera of an image topic by its CameraInfo, of ROS 1 (K) or ROS 2 (k).

    Parameters
    ----------
    info : message
        The CameraInfo.
    own, topic : str
        Topics of the CameraInfo and of the image, whose name tells raw from rectified and aligned images.
    frame_id : str, optional
        Frame of the image, which must be that of the CameraInfo; None if the frames are placeholders.
    of : str
        Ends the name of the camera in errors.

    Raises
    ------
    ConfigError
        If the frames differ, or as `graspbox.captures.cameras.camera_of`.
    """
    if frame_id is not None and str(info.header.frame_id) != frame_id:
        raise ConfigError(
            f"{topic} has the frame {frame_id!r} and {own} the frame {str(info.header.frame_id)!r}, so that they "
            "belong to different cameras; pass the intrinsics of the depth image"
        )
    use = "aligned" if "aligned_depth" in topic else "rectified" if "rect" in _base(topic).name.lower() else "raw"
    return camera_of(_entries(info), f"{own}{of}", use)


def _entries(info: Any) -> dict[str, Any]:
    """Return the entries of a CameraInfo of ROS 1 (K) or ROS 2 (k)."""

    def value(name: str) -> Any:
        return getattr(info, name.lower()) if hasattr(info, name.lower()) else getattr(info, name.upper())

    entries = {name: [float(one) for one in value(name)] for name in "kdp"}
    roi = {name: int(getattr(info.roi, name)) for name in ("x_offset", "y_offset", "width", "height")}
    sizes = {name: int(getattr(info, name)) for name in ("width", "height", "binning_x", "binning_y")}
    return {**entries, **sizes, "roi": roi, "model": str(info.distortion_model)}
