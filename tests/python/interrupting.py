"""Ctrl-C at a moment that is known: when the work of another process has begun, on however busy a machine."""

import signal
import subprocess
import sys
from typing import NamedTuple

__all__ = ["Ended", "interrupted"]

#: A shell starts what it puts in the background deaf to Ctrl-C, and Python leaves it so.
_PRELUDE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
def ready():
    print("ready", file=sys.stderr, flush=True)
"""
#: Seconds after which a process counts as one that does not end. Whoever calls gives it work of hours.
_PATIENCE = 120


class Ended(NamedTuple):
    """How a process ended, and what it wrote after its work had begun."""

    status: int
    stdout: str
    stderr: str


def interrupted(code: str) -> Ended:
    """Run code in another process, send it Ctrl-C when it has called ``ready()``, and wait for its end.

    Raises
    ------
    AssertionError
        If it does not end, or ends before it is ready.
    """
    command = [sys.executable, "-c", _PRELUDE + code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            before: list[str] = []
            while (line := process.stderr.readline()) != "ready\n":
                assert line, "".join(before)
                before.append(line)
            process.send_signal(signal.SIGINT)
            output, errors = process.communicate(timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            raise AssertionError("the process goes on after Ctrl-C") from None
        finally:
            process.kill()
    return Ended(process.returncode, output, errors)
