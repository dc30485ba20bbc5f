"""JSON documents from outside, validated field by field before use (pydantic, from the extra ``data``)."""

from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from graspbox._common.files import read_bounded
from graspbox._common.imports import imported
from graspbox.errors import ConfigError

__all__ = ["parse", "read"]

Document = TypeVar("Document")


def read(kind: type[Document], path: Path, limit: int, description: str) -> Document:
    """Read a JSON file of at most `limit` bytes, a `description`, as a dataclass; ignores other fields."""
    return parse(kind, read_bounded(path, limit), f"{str(path)!r} is not a valid {description}")


def parse(kind: type[Document], content: bytes, complaint: str) -> Document:
    """Parse JSON as `read` does; an error begins with `complaint`."""
    pydantic = _pydantic()
    try:
        return cast(Document, _adapter(cast(Any, kind)).validate_json(content, strict=True))
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        if first["type"] == "missing":
            raise ConfigError(f"{complaint}: {where} is missing") from None
        raise ConfigError(f"{complaint}: {where + ': ' if where else ''}{first['msg']}") from None


@cache
def _adapter(kind: Any) -> Any:
    return _pydantic().TypeAdapter(kind)


def _pydantic() -> Any:
    return imported("pydantic", "data sets need the package pydantic", "data")
