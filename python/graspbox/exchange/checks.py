"""Values from files of unknown origin: arrays and numbers, checked before they are converted."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.extras import imported
from graspbox.errors import ConfigError
from graspbox.exchange.grasps import MAX_GRASPS

__all__ = ["matrices", "number", "numbers", "optional_package", "rows_of", "text"]

Array = NDArray[np.float64]


def optional_package(module: str, package: str) -> Any:
    """Import a package of the extra ``exchange``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return imported(module, f"this format of grasps needs the package {package}", "exchange")


def rows_of(document: Mapping[str, Any], key: str, name: str = "") -> list[dict[str, Any]]:
    """Return a list of objects in a JSON document, at most `MAX_GRASPS`.

    Raises
    ------
    ConfigError
        If it is missing, another type, or longer.
    """
    rows = document.get(key)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigError(f"{name or key} is missing or is not a list of objects")
    if len(rows) > MAX_GRASPS:
        raise ConfigError(f"{name or key} has {len(rows)} entries; give at most {MAX_GRASPS}")
    return rows


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not (isinstance(value, int) and abs(value) > 2**63)


def numbers(values: Any, name: str, *, count: int | None = None) -> Array:
    """Convert a list of numbers or flags to an array (n,); null becomes NaN.

    Raises
    ------
    ConfigError
        If it is no such list, or has another length than `count`.
    """
    if not isinstance(values, list) or not all(value is None or _is_number(value) for value in values):
        raise ConfigError(f"{name} is not a list of numbers")
    if count is not None and len(values) != count:
        raise ConfigError(f"{name} has {len(values)} entries, but there are {count} grasps")
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def matrices(values: Any, name: str) -> Array:
    """Convert a list of 4x4 matrices, as lists of rows, to an array (n, 4, 4).

    Raises
    ------
    ConfigError
        If it is no such list; the message names the first entry that is no such matrix.
    """
    if not isinstance(values, list):
        raise ConfigError(f"{name} is not a list of 4x4 matrices")
    if len(values) > MAX_GRASPS:
        raise ConfigError(f"{name} has {len(values)} entries; give at most {MAX_GRASPS}")
    for index, matrix in enumerate(values):
        rows = matrix if isinstance(matrix, list) and len(matrix) == 4 else [None]
        if not all(isinstance(row, list) and len(row) == 4 and all(map(_is_number, row)) for row in rows):
            raise ConfigError(f"{name}[{index}] is not a 4x4 matrix of numbers; give 4 rows of 4 numbers")
    return np.array(values, dtype=np.float64).reshape(-1, 4, 4)


def number(value: Any, name: str) -> float:
    """Return a number.

    Raises
    ------
    ConfigError
        If it is none, or not finite.
    """
    if not _is_number(value) or isinstance(value, bool) or not np.isfinite(value):
        raise ConfigError(f"{name} is {shown(value)}; give a finite number")
    return float(value)


def text(value: Any, name: str) -> str:
    """Return text.

    Raises
    ------
    ConfigError
        If it is none.
    """
    if not isinstance(value, str):
        raise ConfigError(f"{name} is {shown(value)}; give text")
    return value
