"""A scan of the weights in an ONNX file, without the package onnx: bytes that a network outputs do not show a NaN.

Only the initializers of the graph are read from the format (protocol buffers, ``onnx.proto``).
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["check_weights"]

#: Fields of the messages: the graph of a model, the initializers of a graph, and the contents of a tensor.
_GRAPH, _INITIALIZER = 7, 5
_TYPE, _FLOATS, _NAME, _RAW, _DOUBLES = 2, 4, 8, 9, 10
#: Types of tensors of floats, by their numbers.
_TYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f4"), 10: np.dtype("<f2"), 11: np.dtype("<f8")}
#: Kinds of values: a number of variable length, eight bytes, a length and bytes, four bytes.
_VARINT, _EIGHT, _BYTES, _FOUR = 0, 1, 2, 5


def check_weights(content: bytes, called: str) -> None:
    """Refuse weights that are not finite; onnxruntime reports a file, `called` in errors, that is no network at all.

    A single infinity is no weight but a bound, and allowed.

    Raises
    ------
    ConfigError
        Names the tensor.
    """
    try:
        for graph in _parts(memoryview(content), _GRAPH):
            for tensor in _parts(graph, _INITIALIZER):
                name, values = _tensor(tensor)
                if not _is_finite(values) and (values.size > 1 or np.isnan(values).any()):
                    raise ConfigError(f"{called}: the weights {name!r} are not finite; train or export it again")
    except IndexError:
        return


def _is_finite(values: NDArray[np.floating]) -> bool:
    if values.dtype == np.float16:
        # numpy would convert each number; all bits of the exponent are set for infinity and NaN.
        return not ((values.view(np.uint16) & 0x7C00) == 0x7C00).any()
    return bool(np.isfinite(values).all())


def _parts(message: memoryview, wanted: int) -> Iterator[memoryview]:
    return (value for number, value in _fields(message) if number == wanted and isinstance(value, memoryview))


def _tensor(message: memoryview) -> tuple[str, NDArray[np.floating]]:
    """Return the name and the numbers of a tensor; none where they are no floats."""
    dtype: np.dtype[Any] | None = None
    name, raw = "", memoryview(b"")
    for number, value in _fields(message):
        if isinstance(value, int):
            dtype = _TYPES.get(value) if number == _TYPE else dtype
        elif number == _NAME:
            name = bytes(value).decode(errors="replace")
        elif number in (_RAW, _FLOATS, _DOUBLES):
            raw = value
    if dtype is None or not len(raw):
        return name, np.zeros(0)
    return name, np.frombuffer(raw, dtype, len(raw) // dtype.itemsize)


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield the fields of a message by their numbers; raises IndexError where it is cut off or is none."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield number, value
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_EIGHT, _FOUR):
            size = 8 if kind == _EIGHT else 4
        else:
            raise IndexError
        if at + size > len(message):
            raise IndexError
        yield number, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        value, at, shift = value | (byte & 0x7F) << shift, at + 1, shift + 7
        if byte < 0x80:
            return value, at
        if shift > 63:
            raise IndexError
