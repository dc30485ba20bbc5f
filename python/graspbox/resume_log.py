"""A log of JSON lines from which a long job resumes after an interruption."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.files import take_lock

__all__ = ["ResumeLog", "changes"]


class ResumeLog:
    """Rows of results; each is on the disk when `append` returns.

    Parameters
    ----------
    path : str or PathLike
        The file; its folder is created. An incomplete last line, left by an interruption, is removed.
    settings : dict
        What the rows depend on, as plain JSON values; written as the first line.
    fresh : bool
        Begin anew: the rows are left from a job that has nothing else to resume from.

    Raises
    ------
    ConfigError
        If the file was begun with other settings, is not a log, or another process writes into it.
    """

    def __init__(self, path: str | os.PathLike[str], settings: dict[str, Any], *, fresh: bool = False) -> None:
        self.path = Path(path)
        self.rows: list[dict[str, Any]] = []
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.touch()
        _lock(self.path)
        content = b"" if fresh else self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.decode(errors="replace").splitlines()
        if not lines:
            self.path.write_text("")
            self._write({"settings": settings})
            return
        try:
            first, *self.rows = (json.loads(line) for line in lines)
            known = first["settings"]
        except (ValueError, TypeError, KeyError):
            raise ConfigError(f"{str(self.path)!r} is not a log of this program; name another file") from None
        if known != settings:
            found = "; ".join(changes(known, settings))
            raise ConfigError(f"{str(self.path)!r} was begun with other settings: {found}; name another file")
        if len(whole) < len(content):
            os.truncate(self.path, len(whole))

    def append(self, row: dict[str, Any]) -> None:
        """Write a row to the disk."""
        self._write(row)
        self.rows.append(row)

    def _write(self, row: dict[str, Any]) -> None:
        with self.path.open("a") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())


#: The locks of this process by device and number of the file; they go with the process, however it ends.
_LOCKS: dict[tuple[int, int], int] = {}


def _lock(path: Path) -> None:
    """Keep other processes from writing into a log."""
    descriptor = os.open(path, os.O_RDONLY)
    status = os.fstat(descriptor)
    file = (status.st_dev, status.st_ino)
    if file in _LOCKS:
        os.close(descriptor)
        return
    try:
        take_lock(descriptor, path)
    except ConfigError:
        os.close(descriptor)
        raise
    _LOCKS[file] = descriptor


def changes(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Name what differs between two settings, nested ones by a path with dots."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            yield from changes(old.get(key, _ABSENT), new.get(key, _ABSENT), f"{name}.{key}" if name else key)
    elif isinstance(new, dict) and new:
        yield from changes({}, new, name)
    elif old != new:
        yield f"{name} was {old!r}, is now {new!r}"


class _Absent:
    def __repr__(self) -> str:
        return "absent"


_ABSENT = _Absent()
