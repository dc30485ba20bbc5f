"""Values of JSON files, checked: each error names the file, the field and the remedy."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError

__all__ = ["changed", "facts_of", "item", "read_json", "rows_of", "text"]

#: Greatest size of a file, bytes; a million trials of an evaluation take about half of it.
_MAX_BYTES = 512 << 20
#: Longest text of a fact.
_LONGEST = 2000
_AGAIN = "make the run again, or leave it out"


def read_json(path: Path) -> Any:
    """Read a JSON file of bounded size.

    Raises
    ------
    FileError
        If it cannot be read.
    ConfigError
        If it is not JSON.
    """
    content = read_bounded(path, _MAX_BYTES)
    try:
        return json.loads(content)
    except (ValueError, RecursionError):
        raise ConfigError(f"{str(path)!r} is not JSON; {_AGAIN}") from None


def item(row: Mapping[str, Any], name: str, kind: type | tuple[type, ...], where: str) -> Any:
    """Return a field of a row.

    Raises
    ------
    ConfigError
        If it is missing or has another type; the message names it.
    """
    value = row.get(name) if isinstance(row, Mapping) else None
    numbers = kind in (int, float) and isinstance(value, bool)
    types = (int, float) if kind is float else kind
    if not isinstance(value, types) or numbers:
        wanted = kind.__name__ if isinstance(kind, type) else " or ".join(one.__name__ for one in kind)
        raise ConfigError(f"{where}: {name} is {shown(value)}, not a {wanted}; {_AGAIN}")
    return value


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Read rows of JSON; a last line that an interruption cut off is left out.

    Raises
    ------
    FileError
        If the file cannot be read.
    ConfigError
        If a line is no row.
    """
    content = read_bounded(path, _MAX_BYTES)
    found = []
    for number, line in enumerate(content[: content.rfind(b"\n") + 1].splitlines(), 1):
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            row = None
        if not isinstance(row, dict):
            raise ConfigError(f"{str(path)!r}: line {number} is no row of JSON; {_AGAIN}")
        found.append(row)
    return found


def text(value: Any) -> str:
    """Write a fact as text of bounded length."""
    if isinstance(value, Mapping | list):
        value = json.dumps(value)
    written = "" if value is None else str(value)
    return written if len(written) <= _LONGEST else written[:_LONGEST] + " ..."


def facts_of(values: Mapping[str, Any]) -> dict[str, str]:
    """Write facts as text, and leave out the empty ones."""
    return {name: written for name, value in values.items() if (written := text(value)) not in ("", "{}", "[]")}


def changed(path: Path) -> str:
    """When a file was last changed, UTC."""
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%d %H:%M UTC")
