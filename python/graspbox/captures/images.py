"""Depth images and point arrays from ``.npy``, ``.npz``, ``.png``, ``.tiff`` and ``.exr`` files."""

import struct
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported
from graspbox.captures.capture import Camera, Found
from graspbox.captures.files import read_image
from graspbox.errors import ConfigError

__all__ = ["MOST_PIXELS", "read_array_file", "read_exr", "read_picture"]

#: Most pixels of an image: 8192 x 8192.
MOST_PIXELS = 1 << 26
#: Names of intrinsics in an archive.
_MATRICES = ("K", "intrinsics", "camera_matrix", "cam_K")
#: Tags of TIFF: columns, rows, bits, channels, kind of numbers (1 unsigned, 2 signed, 3 floating point).
_COLUMNS, _ROWS, _BITS, _CHANNELS, _NUMBERS = 256, 257, 258, 277, 339
#: Channels of EXR that hold depth, the best first; the last ones hold it if they are equal.
_CHANNEL_NAMES = ("Z", "depth", "depth.Z", "depth.V", "V", "Y")
#: Distances of pixels without a surface: the largest half number; Blender writes 1e10.
_NOTHING = 65504.0


def read_array_file(path: Path, kind: str) -> Found:
    """Read an image (H, W) or points (n, 3), (H, W, 3) of floats from ``.npy`` or ``.npz``; raises ConfigError."""
    if kind == "npy":
        return _found(path, read_image(path, "depth image", 3 * MOST_PIXELS)[1])
    try:
        with zipfile.ZipFile(path) as archive:
            names = {item.filename.removesuffix(".npy"): item for item in archive.infolist()}
            chosen = "depth" if "depth" in names else next(iter(names), "")
            if not names or (len(names) > 1 and chosen != "depth"):
                raise ConfigError(
                    f"{path} holds {len(names)} arrays ({', '.join(list(names)[:8])}); name the image depth, and its "
                    "intrinsics K"
                )
            values = _member(archive, names[chosen], path)
            matrix = next((name for name in _MATRICES if name in names and name != chosen), None)
            lens = None if matrix is None else _member(archive, names[matrix], path)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, struct.error) as error:
        raise ConfigError(f"{path} is no archive written by numpy.savez: {error}") from None
    except ConfigError:
        raise
    except Exception as error:  # headers are Python's literals, whose parser raises many kinds
        raise ConfigError(f"{path} cannot be read as an archive of arrays: {error}") from None
    found = _found(path, values)
    if lens is not None:
        found.camera = Camera(_centred(lens, f"{matrix} of {path}"), str(path))
    return found


def _found(path: Path, values: NDArray[np.generic]) -> Found:
    """Tell points from an image by shape and type."""
    image = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
    many = image.ndim == 2 and image.shape[1] == 3 < image.shape[0]
    if values.dtype.kind == "f" and (many or (image.ndim == 3 and image.shape[2] == 3)):
        return Found(str(path), points=image)
    return Found(str(path), image=image)


def _centred(matrix: NDArray[np.generic], name: str) -> NDArray[np.float64]:
    """Return intrinsics whose pixel centres are at integers, in graspbox's convention."""
    if matrix.shape != (3, 3) or matrix.dtype.kind not in "fiu":
        raise ConfigError(f"{name} is {matrix.dtype} of shape {matrix.shape}; pass intrinsics (3, 3) in pixels")
    lens = matrix.astype(np.float64)
    lens[:2, 2] += 0.5
    return lens


def _member(archive: zipfile.ZipFile, item: zipfile.ZipInfo, path: Path) -> NDArray[np.generic]:
    """Read an array of an archive, its header first: one that promises too much is refused."""
    if item.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ConfigError(
            f"{path} is compressed by a method ({item.compress_type}; zstd is 93) that not every Python reads; save it "
            "with numpy.savez or numpy.savez_compressed"
        )
    with archive.open(item) as file:
        shape, dtype = _header(file)
    if dtype.hasobject:
        raise ConfigError(f"{path}: {item.filename} holds Python objects; save arrays of numbers alone")
    size = dtype.itemsize
    for length in shape:
        size *= length
    if size > 24 * MOST_PIXELS or size > item.file_size:
        raise ConfigError(
            f"{path}: {item.filename} promises an array {shape} that it does not hold, or that is too large"
        )
    with archive.open(item) as file:
        array: NDArray[np.generic] = np.lib.format.read_array(file, allow_pickle=False)
        return array


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"its format has the version {version}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    return shape, dtype


def read_picture(path: Path, kind: str) -> Found:
    """Read a depth image (H, W) from PNG or TIFF; raises ConfigError for 8 bits, colours and several pages."""
    if kind == "tiff":
        return Found(str(path), image=_read_tiff(path))
    mode, values = read_image(path, "depth image", MOST_PIXELS)
    if not mode.startswith("I"):
        raise ConfigError(
            f"{path} is a picture of the kind {mode!r} with 8 bits per value, which a depth image for people is; "
            "pass the camera's own 16-bit image, of one channel"
        )
    return Found(str(path), image=values)


def _read_tiff(path: Path) -> NDArray[np.generic]:
    tags, pages = _tiff_tags(path)
    bits, numbers, channels = tags.get(_BITS, 1), tags.get(_NUMBERS, 1), tags.get(_CHANNELS, 1)
    again = "read it with the package tifffile and save its image with numpy.save"
    if pages > 1:
        raise ConfigError(f"{path} has several pages, of which one is the image; {again}: tifffile.imread(FILE, key=0)")
    if channels != 1:
        raise ConfigError(f"{path} has {channels} channels; {again}, of the one channel that holds the depth")
    if numbers == 3 and bits != 32:
        raise ConfigError(f"{path} holds floating-point numbers of {bits} bits; {again}")
    if bits not in (16, 32):
        raise ConfigError(f"{path} has {bits} bits per value; pass the camera's own image of 16 bits")
    if tags.get(_COLUMNS, 0) * tags.get(_ROWS, 0) > MOST_PIXELS:
        raise ConfigError(f"{path} has more than {MOST_PIXELS} pixels; pass a smaller image, with its own intrinsics")
    pillow = imported("PIL.Image", "TIFF files need Pillow, from the extra 'cli'", "cli")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with pillow.open(path, formats=("TIFF",)) as image:
                values: NDArray[np.generic] = np.asarray(image)
    except Exception as error:  # Pillow raises many kinds for broken files
        raise ConfigError(f"{path} cannot be read as TIFF ({error}); {again}") from None
    return values


def _tiff_tags(path: Path) -> tuple[dict[int, int], int]:
    """Return the first value of the tags of the first page that decide, and the number of pages, at most 2."""
    with path.open("rb") as file:
        start = file.read(8)
        order = "<" if start[:2] == b"II" else ">"
        try:
            version, place = struct.unpack(order + "HI", start[2:])
            if version != 42:
                raise ConfigError(f"{path} is a BigTIFF; save its image with numpy.save, or as a TIFF below 4 GB")
            file.seek(place)
            (count,) = struct.unpack(order + "H", file.read(2))
            entries, after = file.read(12 * count), file.read(4)
            tags = {}
            for at in range(0, 12 * count, 12):
                tag, kind, number = struct.unpack_from(order + "HHI", entries, at)
                # Longer values stand elsewhere: those of a tag per channel, where one channel is expected.
                if number == 1 and kind in (3, 4):
                    tags[tag] = struct.unpack_from(order + ("H" if kind == 3 else "I"), entries, at + 8)[0]
            return tags, 2 if struct.unpack(order + "I", after)[0] else 1
        except struct.error:
            raise ConfigError(f"{path} ends within its header; write the TIFF file again") from None


def read_exr(path: Path) -> Found:
    """Read a depth image from OpenEXR: a channel named Z, depth.Z, V or Y, or equal R, G and B; raises ConfigError."""
    exr = imported("OpenEXR", "EXR files need the package OpenEXR, from the extra 'exr'", "exr")
    try:
        for part in exr.File(str(path), header_only=True).parts:
            low, high = part.header["dataWindow"]
            if (int(high[0]) - int(low[0]) + 1) * (int(high[1]) - int(low[1]) + 1) > MOST_PIXELS:
                raise ConfigError(f"{path} has more than {MOST_PIXELS} pixels; pass a smaller image")
        parts = exr.File(str(path), separate_channels=True).parts
        channels = [({name: one.pixels for name, one in part.channels.items()}, part.header) for part in parts]
    except ConfigError:
        raise
    except Exception as error:  # the library raises RuntimeError and others for broken files
        raise ConfigError(f"{path} cannot be read as OpenEXR: {error}") from None
    values, header = _depth_channel(channels, path)
    (left, top), (first, last) = header["dataWindow"][0], header["displayWindow"]
    depth = values.astype(np.float64)
    nothing = np.isfinite(depth) & (depth >= _NOTHING)
    depth[nothing] = 0.0
    size = (int(last[0]) - int(first[0]) + 1, int(last[1]) - int(first[1]) + 1)
    found = Found(str(path), image=depth, full_size=size, offset=(int(left), int(top)))
    if nothing.any():
        found.warnings.append(f"{nothing.mean():.0%} of the pixels are at 65504 or farther: nothing was measured there")
    return found


def _depth_channel(channels: list[tuple[dict[str, Any], Any]], path: Path) -> tuple[NDArray[np.generic], Any]:
    for wanted in _CHANNEL_NAMES:
        for held, header in channels:
            for name, pixels in held.items():
                if name == wanted or (wanted == "Z" and name.endswith(".Z")):
                    return pixels, header
    for held, header in channels:
        colours = [held.get(name) for name in "RGB"]
        if colours[0] is not None and all(
            one is not None and np.array_equal(one, colours[0], equal_nan=True) for one in colours
        ):
            return colours[0], header
    names = sorted({name for held, _ in channels for name in held})
    raise ConfigError(
        f"{path} has the channels {', '.join(names[:12])}, of which none is a depth; name it Z, in metres along the "
        "optical axis"
    )
