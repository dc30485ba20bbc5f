"""Values from files of unknown origin: arrays and numbers, checked before they are converted; errors name the entry."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox._common.imports import imported
from graspbox.errors import ConfigError
from graspbox.tools.exchange.grasps import MAX_GRASPS

__all__ = ["matrices", "number", "numbers", "optional_package", "read_json", "rows_of", "text"]

Array = NDArray[np.float64]

#: Largest JSON file, bytes.
MAX_JSON = 256 << 20


def optional_package(module: str, package: str) -> Any:
    """Import a package of the extra ``exchange``."""
    return imported(module, f"this format of grasps needs the package {package}", "exchange")


def read_json(path: Path) -> Any:
    """Read a JSON file of at most `MAX_JSON` bytes."""
    try:
        return json.loads(read_bounded(path, MAX_JSON))
    except (ValueError, RecursionError):
        raise ConfigError("it is not JSON, or a damaged file; copy it again") from None


def rows_of(document: Mapping[str, Any], key: str, name: str = "") -> list[dict[str, Any]]:
    """Return a list of objects in a JSON document, at most `MAX_GRASPS`."""
    rows = document.get(key)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigError(f"{name or key} is missing or is not a list of objects")
    if len(rows) > MAX_GRASPS:
        raise ConfigError(f"{name or key} has {len(rows)} entries; use at most {MAX_GRASPS}")
    return rows


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not (isinstance(value, int) and abs(value) > 2**63)


def numbers(values: Any, name: str, *, count: int | None = None) -> Array:
    """Convert a list of `count` numbers or flags to an array (n,); null becomes NaN."""
    if not isinstance(values, list) or not all(value is None or _is_number(value) for value in values):
        raise ConfigError(f"{name} is not a list of numbers")
    if count is not None and len(values) != count:
        raise ConfigError(f"{name} has {len(values)} entries, but there are {count} grasps")
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def matrices(values: Any, name: str) -> Array:
    """Convert a list of 4x4 matrices, as lists of rows, to an array (n, 4, 4)."""
    if not isinstance(values, list):
        raise ConfigError(f"{name} is not a list of 4x4 matrices")
    if len(values) > MAX_GRASPS:
        raise ConfigError(f"{name} has {len(values)} entries; use at most {MAX_GRASPS}")
    for index, matrix in enumerate(values):
        rows = matrix if isinstance(matrix, list) and len(matrix) == 4 else [None]
        if not all(isinstance(row, list) and len(row) == 4 and all(map(_is_number, row)) for row in rows):
            raise ConfigError(f"{name}[{index}] is not a 4x4 matrix of numbers; use 4 rows of 4 numbers")
    return np.array(values, dtype=np.float64).reshape(-1, 4, 4)


def number(value: Any, name: str) -> float:
    """Return a finite number."""
    if not _is_number(value) or isinstance(value, bool) or not np.isfinite(value):
        raise ConfigError(f"{name} is {shown(value)}; use a finite number")
    return float(value)


def text(value: Any, name: str) -> str:
    """Return text."""
    if not isinstance(value, str):
        raise ConfigError(f"{name} is {shown(value)}; use text")
    return value
