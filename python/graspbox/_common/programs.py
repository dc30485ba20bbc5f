"""Warnings and termination of programs: the exit status of every kind of error, and closed outputs.

The command line and every program in ``scripts`` end with `run_program`.
"""

import errno
import io
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from graspbox.errors import ConfigError, GraspboxError, InternalError, MissingExtraError, ObjectSetError

__all__ = ["run_program"]

#: Status of a program whose reader closed its output: that of a shell's programs, 128 and the number of SIGPIPE.
_CLOSED = 141


def run_program(main: Callable[[], object]) -> NoReturn:
    """Run a program and exit with its status.

    An error of graspbox becomes one line on standard error. The status is the integer that `main`
    returns or exits with, and 0 for None; 1 if something could not be done or written, 2 for a wrong call, 130 after
    Ctrl-C. If a reader such as ``head`` closes the output, the program ends silently with 141, as after SIGPIPE.

    A warning of graspbox becomes one line on standard error, once, unless the program sets logging up itself.
    """
    for stream in (sys.stdout, sys.stderr):
        # File names may contain bytes that the encoding of the terminal does not support.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    with _warnings_shown():
        status = _status(main)
    raise SystemExit(status)


class _Warnings(logging.Handler):
    """Writes each warning once, unless another handler writes it."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._written: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        others = [*logging.getLogger("graspbox").handlers, *logging.getLogger().handlers]
        text = " ".join(record.getMessage().split())
        if text not in self._written and all(one is self or isinstance(one, logging.NullHandler) for one in others):
            self._written.add(text)
            _complain(text)


@contextmanager
def _warnings_shown() -> Iterator[None]:
    handler, logger = _Warnings(), logging.getLogger("graspbox")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _status(main: Callable[[], object]) -> int:
    try:
        try:
            code = main()
        except SystemExit as ended:
            if isinstance(ended.__context__, BrokenPipeError):  # click's
                raise ended.__context__ from None
            code = ended.code
        sys.stdout.flush()
        if isinstance(code, str):
            print(code, file=sys.stderr)
        return code if isinstance(code, int) else 0 if code is None else 1
    except InternalError:
        raise
    except GraspboxError as error:
        _complain(str(error))
        return 2 if isinstance(error, ConfigError | ObjectSetError | MissingExtraError) else 1
    except KeyboardInterrupt:
        return 130
    except MemoryError:
        _complain("there is not enough memory")
        return 1
    except OSError as error:
        if error.filename is not None:
            _complain(f"{error.strerror}: {error.filename}")
            return 1
        _close_output()
        if error.errno == errno.EPIPE:
            return _CLOSED
        _complain(f"the output cannot be written: {error.strerror}")
        return 1


def _complain(sentence: str) -> None:
    print(f"graspbox: {sentence}", file=sys.stderr)


def _close_output() -> None:
    """Discard pending output, which Python would otherwise try to write at exit."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
