"""Values of JSON files, checked: each error names the file, the field and the remedy."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graspbox import object_sets
from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError, GraspboxError
from graspbox.object_sets import ObjectSpec

#: Greatest size of a file, bytes; a million trials of an evaluation take about half of it.
_MAX_BYTES = 512 << 20
#: Longest text of a fact.
_LONGEST = 2000
_AGAIN = "make the run again, or leave it out"


def read_json(path: Path) -> Any:
    """Read a JSON file of bounded size; FileError if it cannot be read, ConfigError if it is not JSON."""
    content = read_bounded(path, _MAX_BYTES)
    try:
        return json.loads(content)
    except (ValueError, RecursionError):
        raise ConfigError(f"{str(path)!r} is not JSON; {_AGAIN}") from None


def item(row: Mapping[str, Any], name: str, kind: type, where: str) -> Any:
    """Return a field of a row; ConfigError, which names it, if it is missing or has another type."""
    value = row.get(name) if isinstance(row, Mapping) else None
    numbers = kind in (int, float) and isinstance(value, bool)
    types = (int, float) if kind is float else kind
    if not isinstance(value, types) or numbers:
        raise ConfigError(f"{where}: {name} is {shown(value)}, not a {kind.__name__}; {_AGAIN}")
    return value


def mapping_of(row: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return an optional object of JSON; empty if it is missing or has another type."""
    value = row.get(name)
    return value if isinstance(value, Mapping) else {}


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Read rows of JSON, without a last line that an interruption cut off; errors as of `read_json`."""
    content = read_bounded(path, _MAX_BYTES)
    checked = []
    for number, line in enumerate(content[: content.rfind(b"\n") + 1].splitlines(), 1):
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            row = None
        if not isinstance(row, dict):
            raise ConfigError(f"{str(path)!r}: line {number} is no row of JSON; {_AGAIN}")
        checked.append(row)
    return checked


def text(value: Any) -> str:
    """Write a fact as text of bounded length."""
    if isinstance(value, Mapping | list):
        value = json.dumps(value)
    written = "" if value is None else str(value)
    return written if len(written) <= _LONGEST else written[:_LONGEST] + " ..."


def facts_of(values: Mapping[str, Any]) -> dict[str, str]:
    """Write facts as text, without empty ones."""
    return {name: written for name, value in values.items() if (written := text(value)) not in ("", "{}", "[]")}


def spec_of(row: Any) -> ObjectSpec | None:
    """Return the object of a row with source, scale and mass; None if it is not on this machine or has no source."""
    try:
        return object_sets.load(str(row["source"]), scale=float(row["scale"]), mass=row["mass"])[0]
    except (GraspboxError, KeyError, TypeError, ValueError):
        return None


def changed(path: Path) -> str:
    """Return when a file was last changed, UTC."""
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y-%m-%d %H:%M UTC")
