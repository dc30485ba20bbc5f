"""JSON documents from outside, validated field by field before use (pydantic, from the extra ``data``)."""

from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from graspbox._common.extras import imported
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError

__all__ = ["parse", "read"]

Document = TypeVar("Document")


def read(kind: type[Document], path: Path, limit: int, description: str) -> Document:
    """Read a JSON file of at most `limit` bytes as an instance of a dataclass; ignores other fields.

    Raises
    ------
    FileError
        If it cannot be read, or is larger.
    ConfigError
        If it is not JSON, a field is missing, or one has another type; `description` names the expected file.
    MissingExtraError
        Without pydantic.
    """
    return parse(kind, read_bounded(path, limit), f"{str(path)!r} is not a valid {description}")


def parse(kind: type[Document], content: bytes, complaint: str) -> Document:
    """Parse JSON as `read` does; an error begins with `complaint`."""
    pydantic = _pydantic()
    try:
        found: Document = _adapter(cast(Any, kind)).validate_json(content, strict=True)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        if first["type"] == "missing":
            raise ConfigError(f"{complaint}: {where} is missing") from None
        raise ConfigError(f"{complaint}: {where + ': ' if where else ''}{first['msg']}") from None
    return found


@cache
def _adapter(kind: Any) -> Any:
    return _pydantic().TypeAdapter(kind)


def _pydantic() -> Any:
    return imported("pydantic", "data sets need the package pydantic", "data")
