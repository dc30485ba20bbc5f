"""Point clouds from PLY files: text and both binary byte orders; only the coordinates of ``vertex`` are read.

Format: Greg Turk, "The PLY polygon file format", 1994.
"""

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox.captures.clouds import LARGEST_FILE, MOST_POINTS, text_columns
from graspbox.errors import ConfigError

__all__ = ["read_ply"]

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Longest header, bytes; most elements with lists that are skipped before the vertices, since each is walked through.
_LONGEST_HEADER, _MOST_LISTS = 1 << 16, 1_000_000
#: Most elements and properties of a header.
_MOST_NAMES = 1000


@dataclass
class _Element:
    """An element of the header: name, count, and (name, type, type of the count of a list or "") of its properties."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


def read_ply(path: Path) -> NDArray[np.float64]:
    """Read the points (n, 3) of a PLY file, in its units; coordinates may be NaN.

    Raises
    ------
    ConfigError, FileError
        If it is broken, has no vertices with x, y and z, or is too large.
    """
    content = read_bounded(path, LARGEST_FILE)
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    line_end = content.find(b"\n", end)
    if end < 0 or line_end < 0:
        raise ConfigError(f"{path} has no complete header of PLY; write the file again")
    order, elements = _header(content[:end].decode("latin-1"), path)
    position = next((i for i, element in enumerate(elements) if element.name == "vertex"), None)
    if position is None:
        raise ConfigError(f"{path} has no element 'vertex'; pass a PLY file of points")
    vertex, before = elements[position], elements[:position]
    names = [name for name, _, _ in vertex.properties]
    if not {"x", "y", "z"} <= set(names) or any(lists for _, _, lists in vertex.properties):
        raise ConfigError(f"{path} has vertices with {shown(names)}; pass vertices with x, y and z, without lists")
    if len(set(names)) != len(names):
        raise ConfigError(f"{path} names a property of its vertices twice; write the file again")
    if not 0 < vertex.count <= MOST_POINTS:
        raise ConfigError(f"{path} has {vertex.count} points; pass 1 to {MOST_POINTS}")
    body = memoryview(content)[line_end + 1 :]
    if not order:
        skipped = sum(element.count for element in before)
        return text_columns(io.BytesIO(body), [names.index(axis) for axis in "xyz"], skipped, vertex.count, path)
    kind = np.dtype([(name, order + _TYPES[kind]) for name, kind, _ in vertex.properties])
    start = 0
    for element in before:
        start = _after(body, start, element, order, path)
    if vertex.count * kind.itemsize > len(body) - start:
        raise ConfigError(f"{path} promises {vertex.count} points and ends before; write the file again")
    rows = np.frombuffer(body, kind, vertex.count, start)
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _header(text: str, path: Path) -> tuple[str, list[_Element]]:
    """Return the byte order, "" for text, and the elements."""
    order, elements = None, list[_Element]()
    for number, line in enumerate(text.splitlines()[1:]):
        words = line.split()
        try:
            if number > _MOST_NAMES:
                raise ValueError
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                order = _ORDERS[words[1]]
            elif words[0] == "element":
                elements.append(_Element(words[1], _count(words[2])))
            elif words[0] == "property" and words[1] == "list":
                _TYPES[words[2]], _TYPES[words[3]]
                elements[-1].properties.append((words[4], words[3], words[2]))
            elif words[0] == "property":
                _TYPES[words[1]]
                elements[-1].properties.append((words[2], words[1], ""))
            else:
                raise ValueError
        except (IndexError, KeyError, ValueError):
            raise ConfigError(f"{path} has the line {shown(line)} in its header, which PLY does not know") from None
    if order is None:
        raise ConfigError(f"{path} states no format in its header; write the file again")
    return order, elements


def _count(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 12):
        raise ValueError
    return int(word)


def _after(body: memoryview, start: int, element: _Element, order: str, path: Path) -> int:
    """Return the position after all of a binary element."""
    sizes = [np.dtype(_TYPES[kind]).itemsize for _, kind, _ in element.properties]
    if not any(lists for _, _, lists in element.properties):
        return start + element.count * sum(sizes)
    if element.count > _MOST_LISTS:
        raise ConfigError(f"{path} has {element.count} lists before its vertices; write the vertices first")
    for _ in range(element.count):
        for (_, _, lists), size in zip(element.properties, sizes, strict=True):
            if lists:
                kind = np.dtype(order + _TYPES[lists])
                if start + kind.itemsize > len(body):
                    raise ConfigError(f"{path} ends within its element {element.name!r}; write the file again")
                size *= max(int(np.frombuffer(body, kind, 1, start)[0]), 0)
                start += kind.itemsize
            start += size
    return start
