"""Termination of programs: the exit status of every kind of error, and closed outputs.

The command line and every program in ``scripts`` end with `run_program`.
"""

import errno
import io
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from graspbox.errors import ConfigError, GraspboxError, InternalError, MissingExtraError, ObjectSetError

__all__ = ["run_program"]


def run_program(main: Callable[[], object]) -> NoReturn:
    """Run a program and exit with its status.

    An error of graspbox becomes one line on standard error. The status is the integer that `main`
    returns or exits with, and 0 for None; 1 if something could not be done or written, 2 for a wrong call, 130 after
    Ctrl-C. If a reader such as ``head`` closes the output, the program ends silently.

    Parameters
    ----------
    main : callable
        The program.
    """
    for stream in (sys.stdout, sys.stderr):
        # File names may contain bytes that the encoding of the terminal does not support.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    raise SystemExit(_status(main))


def _status(main: Callable[[], object]) -> int:
    try:
        try:
            code = main()
        except SystemExit as ended:
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
        if error.errno != errno.EPIPE:
            _complain(f"the output cannot be written: {error.strerror}")
        return 1


def _complain(sentence: str) -> None:
    print(f"graspbox: {sentence}", file=sys.stderr)


def _close_output() -> None:
    """Discard pending output, which Python would otherwise try to write at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
