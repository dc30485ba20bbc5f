"""Point clouds from PCD files: ``ascii``, ``binary`` and ``binary_compressed``; only x, y and z are read.

Format: "The PCD (Point Cloud Data) file format", documentation of the Point Cloud Library; compression by LZF, whose
tokens are literals (below 32) and references of a length and a distance.
"""

import io
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox.captures.clouds import LARGEST_FILE, MOST_POINTS, text_columns
from graspbox.errors import ConfigError

__all__ = ["read_pcd"]

_TYPES = {
    (kind, size): f"<{letter}{size}"
    for kind, letter, sizes in (("F", "f", "48"), ("I", "i", "1248"), ("U", "u", "1248"))
    for size in sizes
}
#: Longest header, bytes; most bytes of a decompressed file; most entries of a point.
_LONGEST_HEADER, _LARGEST, _MOST_ENTRIES = 1 << 16, 1 << 30, 10_000
_IDENTITY = ["0", "0", "0", "1", "0", "0", "0"]


@dataclass(frozen=True)
class _Layout:
    """Fields of a point: names, types and counts; columns and rows of the cloud; how the data are stored."""

    names: list[str]
    types: list[np.dtype[np.generic]]
    counts: list[int]
    width: int
    height: int
    data: str

    def sizes(self) -> list[int]:
        """Bytes of each field of a point."""
        return [kind.itemsize * count for kind, count in zip(self.types, self.counts, strict=True)]


def read_pcd(path: Path) -> tuple[NDArray[np.float64], list[str]]:
    """Read the points (n, 3), or (H, W, 3) of an organised cloud, in the units of the file, and warnings.

    Coordinates may be NaN. The viewpoint is not applied: points are those of the sensor's frame.

    Raises
    ------
    ConfigError, FileError
        If it is broken, has no x, y and z, or is too large.
    """
    content = read_bounded(path, LARGEST_FILE)
    header, start = _lines(content, path)
    layout = _layout(header, path)
    number = layout.width * layout.height
    if not 0 < number <= MOST_POINTS:
        raise ConfigError(f"{path} has {number} points; pass 1 to {MOST_POINTS}")
    body = memoryview(content)[start:]
    if layout.data == "ascii":
        firsts = np.cumsum([0, *layout.counts])
        columns = [int(firsts[layout.names.index(axis)]) for axis in "xyz"]
        points = text_columns(io.BytesIO(body), columns, 0, number, path)
    elif layout.data == "binary":
        points = _binary(body, layout, path)
    elif layout.data == "binary_compressed":
        points = _compressed(body, layout, path)
    else:
        raise ConfigError(f"{path} stores its data as {shown(layout.data)}; known are ascii, binary, binary_compressed")
    notes = []
    if header.get("VIEWPOINT", _IDENTITY) != _IDENTITY and _moved(header["VIEWPOINT"]):
        notes.append("the file states a viewpoint, which is not applied: points are taken as in the camera's frame")
    return points.reshape(layout.height, layout.width, 3) if layout.height > 1 else points, notes


def _moved(viewpoint: list[str]) -> bool:
    try:
        return not np.allclose([float(word) for word in viewpoint], [float(word) for word in _IDENTITY])
    except ValueError:
        return True


def _lines(content: bytes, path: Path) -> tuple[dict[str, list[str]], int]:
    """Return the words of each entry of the header, and where the data begin."""
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = content.find(b"\n", start, _LONGEST_HEADER)
        if end < 0:
            raise ConfigError(f"{path} has no complete header of PCD; write the file again")
        words = content[start:end].decode("latin-1").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header["FIELDS" if words[0].upper() == "COLUMNS" else words[0].upper()] = words[1:]
    return header, start


def _layout(header: dict[str, list[str]], path: Path) -> _Layout:
    names = header.get("FIELDS", [])
    try:
        counts = [_natural(word) for word in header.get("COUNT", ["1"] * len(names))]
        sizes, kinds = header.get("SIZE", ["4"] * len(names)), header.get("TYPE", ["F"] * len(names))
        types = [np.dtype(_TYPES[kind.upper(), size]) for kind, size in zip(kinds, sizes, strict=True)]
        points = _natural(header["POINTS"][0]) if "POINTS" in header else None
        width = _natural(header["WIDTH"][0]) if "WIDTH" in header else points
        height = _natural(header["HEIGHT"][0]) if "HEIGHT" in header else 1
        if width is None or not len(names) == len(types) == len(counts) or sum(counts) > _MOST_ENTRIES:
            raise ValueError
        layout = _Layout(names, types, counts, width, height, header["DATA"][0].lower())
    except (ValueError, KeyError, IndexError):
        raise ConfigError(f"{path} has an incomplete header of PCD, or one that contradicts itself") from None
    if points is not None and points != layout.width * layout.height:
        raise ConfigError(f"{path} states {points} points and {layout.width} x {layout.height}; write the file again")
    if any(names.count(axis) != 1 or counts[names.index(axis)] != 1 for axis in "xyz"):
        raise ConfigError(f"{path} has the fields {shown(names)}; pass points with x, y and z")
    return layout


def _natural(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 10):
        raise ValueError
    return int(word)


def _binary(body: memoryview, layout: _Layout, path: Path) -> NDArray[np.float64]:
    sizes, number = layout.sizes(), layout.width * layout.height
    firsts = np.cumsum([0, *sizes]).tolist()
    if number * firsts[-1] > len(body):
        raise ConfigError(f"{path} promises {number} points and ends before; write the file again")
    chosen = [layout.names.index(axis) for axis in "xyz"]
    kind = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [layout.types[i] for i in chosen],
            "offsets": [firsts[i] for i in chosen],
            "itemsize": firsts[-1],
        }
    )
    rows = np.frombuffer(body, kind, number)
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _compressed(body: memoryview, layout: _Layout, path: Path) -> NDArray[np.float64]:
    """Read data that are stored field by field; padding (``_``) may be left out."""
    number = layout.width * layout.height
    broken = ConfigError(f"{path} has compressed data that do not fit its header; write the file again")
    if len(body) < 8:
        raise broken
    packed, size = struct.unpack("<II", body[:8])
    fields = list(zip(layout.names, layout.types, layout.sizes(), strict=True))
    if size != number * sum(bytes_ for _, _, bytes_ in fields):
        fields = [one for one in fields if one[0] != "_"]
    if size != number * sum(bytes_ for _, _, bytes_ in fields) or size > _LARGEST or packed > len(body) - 8:
        raise broken
    try:
        data = _unpacked(bytes(body[8 : 8 + packed]), size)
    except (IndexError, ValueError):
        raise broken from None
    columns, start = {}, 0
    for name, kind, bytes_ in fields:
        if name in ("x", "y", "z"):
            columns[name] = np.frombuffer(data, kind, number, start).astype(np.float64)
        start += number * bytes_
    return np.stack([columns[axis] for axis in "xyz"], axis=1)


def _unpacked(data: bytes, size: int) -> bytearray:
    """Decompress LZF; raises IndexError and ValueError for broken data."""
    out, at, end = bytearray(), 0, len(data)
    while at < end:
        token = data[at]
        at += 1
        if token < 32:
            if at + token >= end:
                raise ValueError
            out += data[at : at + token + 1]
            at += token + 1
        else:
            length = token >> 5
            if length == 7:
                length += data[at]
                at += 1
            length += 2
            first = len(out) - ((token & 31) << 8) - data[at] - 1
            at += 1
            if first < 0:
                raise ValueError
            if first + length <= len(out):
                out += out[first : first + length]
            else:  # a reference into what it writes repeats
                piece = out[first:]
                out += (piece * (length // len(piece) + 1))[:length]
        if len(out) > size:
            raise ValueError
    if len(out) != size:
        raise ValueError
    return out
