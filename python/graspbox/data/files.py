"""Parquet files whose hashes a manifest records: shared by data sets of trials and by demonstrations."""

import hashlib
import os
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from re import Pattern
from typing import TYPE_CHECKING, Any

from graspbox import _core
from graspbox._common.files import read_bounded, replacing
from graspbox._common.imports import imported
from graspbox.errors import ConfigError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "MANIFEST",
    "check_names",
    "parquet",
    "parquet_bytes",
    "pyarrow",
    "read_checked",
    "sha256",
    "versions",
    "write_durably",
]

MANIFEST = "manifest.json"
_COMPRESSION_LEVEL = 3
#: Greatest size of a file, bytes.
_LARGEST = 1 << 36


def pyarrow() -> Any:
    """Import ``pyarrow``, or raise `MissingExtraError`."""
    return imported("pyarrow", "data sets need the package pyarrow", "data")


def parquet() -> Any:
    """Import ``pyarrow.parquet``, or raise `MissingExtraError`."""
    return imported("pyarrow.parquet", "data sets need the package pyarrow", "data")


def versions() -> dict[str, str]:
    """Versions of the packages that determine the bytes of a file."""
    return {"graspbox": _core.__version__, "numpy": version("numpy"), "pyarrow": version("pyarrow")}


def sha256(content: bytes) -> str:
    """Hash the contents of a file."""
    return hashlib.sha256(content).hexdigest()


def parquet_bytes(table: "pa.Table", row_group_size: int) -> bytes:
    """Convert a table to the contents of a Parquet file (zstd)."""
    sink = pyarrow().BufferOutputStream()
    options = {"compression": "zstd", "compression_level": _COMPRESSION_LEVEL, "row_group_size": row_group_size}
    parquet().write_table(table, sink, **options)
    return bytes(sink.getvalue())


def read_checked(path: Path, digest: str | None, remedy: str) -> bytes:
    """Read a file; if it is missing, or its hash is not `digest`, the `ConfigError` names the `remedy`."""
    if not path.is_file():
        raise ConfigError(f"{str(path)!r} is missing; {remedy}")
    content = read_bounded(path, _LARGEST)
    if sha256(content) != digest:
        raise ConfigError(f"{str(path)!r} is damaged: its hash differs from {MANIFEST}; remove it, and {remedy}")
    return content


def check_names(names: Iterable[str], pattern: Pattern[str], complaint: str) -> None:
    """Refuse file names of a manifest that do not match; the error begins with `complaint`."""
    for name in names:
        if not pattern.fullmatch(name):
            raise ConfigError(f"{complaint}: it names the file {name!r}")


def write_durably(path: Path, content: bytes) -> None:
    """Write a file atomically, even if the machine loses power."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
