"""Equality of data classes that hold arrays."""

from dataclasses import fields
from typing import Any

import numpy as np

__all__ = ["ByValue"]


class ByValue:
    """Base of dataclasses (declared with ``eq=False``) that are equal if all their fields are equal.

    Arrays are compared by shape and value, and NaN equals NaN. The objects are unhashable, because arrays are mutable.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [f.name for f in fields(self)]  # type: ignore[arg-type]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]


def _equal(first: Any, second: Any) -> bool:
    """Compare two fields, either of which may be None; NaN, which differs from itself, equals NaN here."""
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == second.dtype.kind == "f")
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return False
    return bool(first == second or (first != first and second != second))
