"""Packages of the extras, imported on demand."""

from importlib import import_module
from typing import Any

from graspbox.errors import MissingExtraError

__all__ = ["imported"]


def imported(module: str, need: str, extra: str) -> Any:
    """Import a module; `need` names the feature that needs its package, and `extra` installs it.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != module.partition(".")[0]:
            raise
        raise MissingExtraError(f"{need}: pip install 'graspbox[{extra}]'") from None
