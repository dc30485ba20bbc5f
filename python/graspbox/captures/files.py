"""Files beside depth: the kind of a file by its first bytes, arrays and PNG files, labels, points, poses of cameras."""

import io
import json
import os
import re
import struct
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._common.files import read_bounded
from graspbox._common.imports import imported
from graspbox.errors import ConfigError, FileError
from graspbox.perception.depth_images import MOST_PIXELS, check_points, check_pose, check_size

__all__ = [
    "DEPTH_SUFFIXES",
    "RECORDING_SUFFIXES",
    "kind_of",
    "read_image",
    "read_labels",
    "read_points",
    "read_pose",
    "refusal",
]

#: Suffixes of depth images and clouds, and of the files of recordings.
DEPTH_SUFFIXES = frozenset({".npy", ".npz", ".png", ".tif", ".tiff", ".exr", ".ply", ".pcd"})
RECORDING_SUFFIXES = frozenset({".bag", ".db3", ".mcap"})
#: Largest file of a camera's pose, bytes.
_LARGEST_POSE = 1 << 20
#: First bytes of the kinds of files that cameras and programs write.
_MAGIC = (
    (b"\x93NUMPY", "npy"),
    (b"PK\x03\x04", "npz"),
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"II*\0", "tiff"),
    (b"MM\0*", "tiff"),
    (b"II+\0", "tiff"),
    (b"MM\0+", "tiff"),
    (b"v/1\x01", "exr"),
    (b"ply", "ply"),
    (b"#ROSBAG", "bag"),
    (b"SQLite format 3\0", "db3"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"\xff\xd8\xff", "jpg"),
    (b"\x1aE\xdf\xa3", "mkv"),
    (b"NI10", "oni"),
    (b"\x89HDF\r\n\x1a\n", "h5"),
)
#: First lines of PCD files, comments before them included.
_PCD = re.compile(rb"\s*(#[^\n]*\n\s*)*(VERSION|FIELDS|COLUMNS)\s")
#: Kinds that `graspbox.captures.read_capture` reads, besides those of `read_image`.
_CAPTURES = {
    "npz": "an archive of arrays (.npz)",
    "tiff": "a TIFF file",
    "exr": "an OpenEXR file",
    "ply": "a PLY file",
    "pcd": "a PCD file",
    "bag": "a ROS recording",
    "db3": "a ROS recording",
    "mcap": "a recording (MCAP)",
}
#: Kinds that are not read, with the conversion to one that is.
_REFUSED = {
    "jpg": "a JPEG picture, with 8 changed bits per value; pass the camera's own 16-bit image",
    "mkv": "a Matroska video, as of Azure Kinect; extract an image: ffmpeg -i FILE.mkv -map 0:1 -vframes 1 depth.png",
    "oni": "a recording of OpenNI; export a frame as 16-bit PNG, with NiViewer or OpenNI's Python package",
    "h5": "an HDF5 file; save one image of it with numpy.save",
    "sens": "a recording of ScanNet; export its depth images with SensReader",
    "zdf": "a file of Zivid; save the point cloud as PCD or PLY with Zivid Studio",
    "praw": "a file of Photoneo; save the point cloud as PLY, whose unit is the millimetre",
}


def read_labels(path: str | os.PathLike[str], *, max_pixels: int = MOST_PIXELS) -> NDArray[np.int64]:
    """Read the numbers (H, W) of things, 0 for none, from a ``.npy`` file or a ``.png`` of one channel.

    Raises FileError if the file cannot be read, ConfigError if it holds no labels or more than `max_pixels`, and
    MissingExtraError for a ``.png`` without Pillow (extra ``cli``).
    """
    values = read_image(Path(path), "image of labels", max_pixels)[1]
    if values.ndim != 2 or values.dtype.kind not in "biu":
        raise ConfigError(f"{path} holds {values.dtype} of shape {values.shape}; pass one label per pixel (H, W)")
    return values.astype(np.int64)


def read_points(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read the points (k, 3) of obstacles, metres, from a ``.npy`` file; raises FileError, and as `check_points`."""
    path = Path(path)
    if not path.is_file():
        raise FileError(2, "there is no such file of points", str(path))
    if kind_of(path) != "npy":
        raise ConfigError(f"{path} is not an array written by numpy.save; pass points (k, 3) as .npy")
    return check_points(_read_npy(path), str(path))


def kind_of(path: Path) -> str:
    """Return the kind of a file by its first bytes, else its suffix: ``npy``, ``png``, ``pcd``, ...; "" if empty."""
    try:
        with path.open("rb") as file:
            start = file.read(1024)
    except OSError as error:
        raise FileError(error.errno or 5, error.strerror or "it cannot be read", str(path)) from None
    found = next((kind for magic, kind in _MAGIC if start.startswith(magic)), "")
    return found or ("pcd" if start.startswith(b"# .PCD") or _PCD.match(start) else path.suffix.lower()[1:])


def refusal(path: Path, kind: str) -> ConfigError:
    """Return the error of a file whose kind is not read, with what to do."""
    if kind in _REFUSED:
        return ConfigError(f"{path} is {_REFUSED[kind]}")
    if kind in _CAPTURES:
        return ConfigError(
            f"{path} is {_CAPTURES[kind]}; read it with graspbox.captures.read_capture, as graspbox grasp-image does, "
            "or save its image with numpy.save"
        )
    return ConfigError(f"{path} is not an array written by numpy.save, nor an image of a known kind; pass .npy or .png")


def _read_npy(path: Path) -> NDArray[np.generic]:
    try:
        # Mapped: a header that promises a huge array costs nothing.
        array: NDArray[np.generic] = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a header is a literal of Python, whose parser raises many kinds
        why = str(error)
        if "Python objects" in why:
            why = "it holds Python objects, such as a dict; save the image alone"
        elif "pickle" in why:  # numpy takes all other contents for this
            why = "it begins otherwise"
        raise ConfigError(f"{path} is not an array written by numpy.save: {why}") from None
    return array


def read_image(path: Path, what: str, max_pixels: int = MOST_PIXELS) -> tuple[str, NDArray[np.generic]]:
    """Read the mode of Pillow (``I`` for a ``.npy`` file) and the values of an image, called `what` in errors.

    A last axis of one channel is removed; palettes stay indices. Errors as `read_labels`.
    """
    if not path.is_file():
        raise FileError(2, f"there is no such {what}", str(path))
    kind = kind_of(path)
    if kind not in ("png", "npy"):
        raise refusal(path, kind)
    mode, values = _read_png(path, max_pixels) if kind == "png" else ("I", _read_npy(path))
    check_size(values.size, str(path), max_pixels)
    return mode, values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values


def _read_png(path: Path, max_pixels: int) -> tuple[str, NDArray[np.generic]]:
    pillow = imported("PIL.Image", "PNG files need Pillow, from the extra 'cli'", "cli")
    with path.open("rb") as file:
        header = file.read(26)
    # Bits per value and kind of colour, of which 0 is grey: Pillow would keep the upper 8 bits of colours.
    if header[24:25] == b"\x10" and header[25:26] != b"\0":
        raise ConfigError(
            f"{path} has 16 bits per value in several channels; save the channel that holds the depth alone, such as "
            "numpy.save('depth.npy', cv2.imread(FILE, cv2.IMREAD_UNCHANGED)[..., 0])"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pillow.DecompressionBombWarning)
            with pillow.open(path, formats=("PNG",)) as image:
                check_size(image.width * image.height, str(path), max_pixels)
                mode, values = image.mode, np.asarray(image)
    except (pillow.DecompressionBombError, pillow.DecompressionBombWarning):
        check_size(MOST_PIXELS + 1, str(path), max_pixels)
    except (OSError, SyntaxError, ValueError, EOFError, MemoryError, struct.error) as error:
        raise ConfigError(f"{path} is no PNG: {error}") from None
    return mode, values


def read_pose(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read the pose ``table_from_camera`` (4, 4) of a camera from ``.npy``, ``.json`` or text of 16 numbers.

    Raises FileError if the file cannot be read, and otherwise as `check_pose`.
    """
    path = Path(path)
    if not path.is_file():
        raise FileError(2, "there is no such camera pose", str(path))
    content = read_bounded(path, _LARGEST_POSE)
    try:
        if path.suffix.lower() == ".npy":
            values = np.asarray(np.load(io.BytesIO(content), allow_pickle=False), dtype=np.float64)
        elif path.suffix.lower() == ".json":
            values = np.array(json.loads(content), dtype=np.float64)
        else:
            values = np.loadtxt(io.StringIO(content.decode()), delimiter="," if b"," in content else None)
    except (ValueError, TypeError, OverflowError, EOFError, RecursionError, MemoryError) as error:
        raise ConfigError(
            f"{path} cannot be read as numbers ({error}); pass the 16 of table_from_camera, row by row"
        ) from None
    if values.size != 16:
        raise ConfigError(f"{path} holds {values.size} numbers; pass the 16 of table_from_camera, row by row")
    return check_pose(values.reshape(4, 4), str(path))
