"""Equality of data classes that hold arrays."""

from dataclasses import fields
from typing import Any

import numpy as np

__all__ = ["ByValue"]


class ByValue:
    """Base of data classes (declared with ``eq=False``) that are equal if all their fields are.

    Arrays are compared by value and shape, and NaN equals NaN. Such objects have no hash, since arrays can change.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        names = [f.name for f in fields(self)]  # type: ignore[arg-type]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]


def _equal(first: Any, second: Any) -> bool:
    """Compare two fields, one of which may be None; only NaN differs from itself."""
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == second.dtype.kind == "f")
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return False
    return bool(first == second or (first != first and second != second))
