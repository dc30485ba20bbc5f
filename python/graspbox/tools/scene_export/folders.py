"""Folders of exported files, which appear whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from graspbox.errors import ConfigError, FileError

__all__ = ["check_folder", "file_name", "new_folder", "write_all"]


def check_folder(path: str | os.PathLike[str]) -> Path:
    """Check before any work that a folder can be made: it is missing or empty.

    Raises
    ------
    ConfigError
        If it has files.
    FileError
        If it cannot be made, or is a file.
    """
    folder = Path(path)
    try:
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(20, "it is a file; name a folder", str(folder))
        full = folder.is_dir() and any(folder.iterdir())
        folder.resolve().parent.mkdir(parents=True, exist_ok=True)
        if not os.access(folder.resolve().parent, os.W_OK | os.X_OK):
            raise PermissionError(13, "Permission denied", str(folder))
    except OSError as error:
        raise FileError(error.errno, error.strerror or str(error), str(folder)) from None
    except ValueError as error:
        raise FileError(22, str(error), str(folder)) from None
    if full:
        raise ConfigError(f"the folder {str(folder)!r} is not empty; remove it or name another")
    return folder


@contextmanager
def new_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder, which becomes `path` when the block ends without an error.

    Raises
    ------
    ConfigError, FileError
        As `check_folder`, or if a file in it cannot be written.
    """
    folder = check_folder(path)
    target = folder.resolve()
    temporary = target.with_name(f".{target.name[:100]}-{secrets.token_hex(4)}")
    try:
        temporary.mkdir()
        yield temporary
        temporary.replace(target)
    except FileError:
        raise
    except OSError as error:
        raise FileError(error.errno, error.strerror or str(error), str(folder)) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_all(folder: Path, files: Mapping[str, str]) -> None:
    """Write text files by their names relative to `folder`, and the folders that they need."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def file_name(name: str) -> str:
    """Make a name that every file system accepts out of an object's name."""
    safe = re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip("._")
    return safe[:100] or "object"
