"""Atomic writes, reads with a size limit, and folders locked for one writing process."""

import fcntl
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError, FileError

__all__ = ["check_output", "dumps", "locked", "read_bounded", "replacing", "write_bytes", "write_text"]

#: File in a folder that a process locks while it writes there.
_LOCK = ".lock"


def _failure(error: OSError, path: Path) -> FileError:
    return FileError(error.errno, error.strerror or str(error), str(path))


def _is_special(path: Path) -> bool:
    """Return whether a path is a device or a pipe, which is written to directly instead of being replaced."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def check_output(path: str | os.PathLike[str]) -> Path:
    """Check before any work that a file can be written, and make its folder; an existing file is not changed."""
    path = Path(path)
    try:
        if path.is_dir():
            raise IsADirectoryError(21, "it is a folder; name a file in it", str(path))
        if _is_special(path):
            with path.open("ab"):
                return path
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.resolve().parent):
            return path
    except (OSError, ValueError) as error:
        raise _failure(error if isinstance(error, OSError) else OSError(22, str(error)), path) from None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder and lock it against other writing processes; the lock ends with this process at the latest."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / _LOCK).open("ab")
    except OSError as error:
        raise _failure(error, folder) from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(f"another process is writing into {str(folder)!r}; wait for it to end") from None
        yield


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary file with the suffix of `path`, which replaces `path` when the block ends without an error.

    Links are followed; devices and pipes are written to directly. Errors of the system become a `FileError`.
    """
    path = check_output(path)
    if _is_special(path):
        yield path
        return
    target = path.resolve()
    temporary = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(4)}{target.suffix}")
    try:
        # A new file gets the permissions of the umask; a replacement keeps those of the old file.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        if target.exists():
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))
        yield temporary
        temporary.replace(target)
    except OSError as error:
        raise _failure(error, path) from None
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def dumps(value: Any, indent: str = "") -> str:
    """Format readable JSON: objects are indented, but those without nested objects take one line; refuses NaN."""
    inner = indent + "  "
    if isinstance(value, dict) and value and not (indent and _is_flat(value)):
        items = [f"{json.dumps(key)}: {dumps(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(inner + item for item in items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return "[\n" + ",\n".join(inner + dumps(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False)


def _is_flat(value: dict[str, Any]) -> bool:
    lists = [item for item in value.values() if isinstance(item, list)]
    return not any(isinstance(item, dict) for items in ([*value.values()], *lists) for item in items)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file atomically; raises as `replacing`."""
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file atomically; raises as `replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def read_bounded(path: str | os.PathLike[str], limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes; others are a `FileError`."""
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise OSError(22, "it is not a regular file", str(path))
        with path.open("rb") as file:
            # `read` allocates the requested size; some files have no size.
            size = max(os.fstat(file.fileno()).st_size, 1 << 20)
            content = file.read(min(limit, size) + 1)
    except OSError as error:
        raise _failure(error, path) from None
    if len(content) > limit:
        raise FileError(27, f"it is larger than {limit} bytes", str(path))
    return content
