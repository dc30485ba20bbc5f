"""A file of JSON lines that lets a long job go on where it was interrupted."""

import json
import os
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError

__all__ = ["ResumeLog"]


class ResumeLog:
    """Rows that are on the disk as soon as they are appended.

    Parameters
    ----------
    path : str or PathLike
        The file; its folder is made if need be. A last line that an interruption cut off is dropped.
    settings : dict
        What the rows depend on, as plain JSON values; the first line of the file.

    Raises
    ------
    ConfigError
        If the file holds rows of other settings, or is no such file.
    """

    def __init__(self, path: str | os.PathLike[str], settings: dict[str, Any]) -> None:
        self.path = Path(path)
        self.rows: list[dict[str, Any]] = []
        content = self.path.read_bytes() if self.path.is_file() else b""
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.decode(errors="replace").splitlines()
        if not lines:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.write_text("")
            self._write({"settings": settings})
            return
        try:
            first, *self.rows = (json.loads(line) for line in lines)
            known = first["settings"]
        except (ValueError, TypeError, KeyError):
            raise ConfigError(f"{str(self.path)!r} is not a log of this program; name another file") from None
        if known != settings:
            raise ConfigError(f"{str(self.path)!r} was begun with other settings, {known}; name another file")
        if len(whole) < len(content):
            os.truncate(self.path, len(whole))

    def append(self, row: dict[str, Any]) -> None:
        """Add a row, and wait until it is on the disk."""
        self._write(row)
        self.rows.append(row)

    def _write(self, row: dict[str, Any]) -> None:
        with self.path.open("a") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())
