"""Packages of the extras ``data`` and ``ray``, imported on demand."""

from typing import Any

from graspbox._common.extras import imported

__all__ = ["parquet", "pyarrow", "ray"]


def pyarrow() -> Any:
    """Import ``pyarrow``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return imported("pyarrow", "data sets need the package pyarrow", "data")


def parquet() -> Any:
    """Import ``pyarrow.parquet``; raises as `pyarrow`."""
    return imported("pyarrow.parquet", "data sets need the package pyarrow", "data")


def ray() -> Any:
    """Import ``ray``; raises as `pyarrow`."""
    return imported("ray", "data sets need the package ray", "ray")
