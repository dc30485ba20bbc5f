"""Packages of the extras ``data`` and ``ray``, imported on demand."""

from importlib import import_module
from typing import Any

from graspbox.errors import MissingExtraError

__all__ = ["parquet", "pyarrow", "ray"]


def _extra(module: str, extra: str) -> Any:
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        if (error.name or "").partition(".")[0] != package:
            raise
        raise MissingExtraError(f"data sets need the package {package}: pip install 'graspbox[{extra}]'") from None


def pyarrow() -> Any:
    """Import ``pyarrow``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return _extra("pyarrow", "data")


def parquet() -> Any:
    """Import ``pyarrow.parquet``; raises as `pyarrow`."""
    return _extra("pyarrow.parquet", "data")


def ray() -> Any:
    """Import ``ray``; raises as `pyarrow`."""
    return _extra("ray", "ray")
