"""Infos of vector environments in Gymnasium's format: a column per entry, each with its mask ``_entry``.

A column is an array, or a dictionary of columns.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["full", "mask_of", "scattered", "taken"]


def mask_of(rows: NDArray[np.intp], count: int) -> NDArray[np.bool_]:
    """Make a mask (count,) that is True at the given rows."""
    mask = np.zeros(count, dtype=np.bool_)
    mask[rows] = True
    return mask


def taken(columns: dict[str, Any], rows: NDArray[np.intp]) -> dict[str, Any]:
    """Select rows of all columns."""
    return {name: taken(v, rows) if isinstance(v, dict) else v[rows] for name, v in columns.items()}


def full(columns: dict[str, Any], count: int) -> dict[str, Any]:
    """Add to every column a mask that is True in all rows."""
    infos: dict[str, Any] = {}
    every = np.ones(count, dtype=np.bool_)
    for name, values in columns.items():
        infos[name] = full(values, count) if isinstance(values, dict) else values
        infos[f"_{name}"] = every.copy()
    return infos


def scattered(columns: dict[str, Any], rows: NDArray[np.intp], count: int) -> dict[str, Any]:
    """Scatter columns of a few rows into columns of `count`, with their masks; other rows are zero, or None."""
    infos: dict[str, Any] = {}
    for name, values in columns.items():
        if isinstance(values, dict):
            infos[name] = scattered(values, rows, count)
        else:
            infos[name] = np.full(count, None if values.dtype == object else 0, dtype=values.dtype)
            infos[name][rows] = values
        infos[f"_{name}"] = mask_of(rows, count)
    return infos
