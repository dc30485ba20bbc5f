"""Signals at a known moment: once the work of another process has begun, even on a busy machine."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

__all__ = ["Ended", "interrupted", "train_despite_kills"]

#: A shell starts background processes with Ctrl-C ignored, and Python keeps this.
_PRELUDE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
def ready():
    print("ready", file=sys.stderr, flush=True)
"""
#: Seconds after which a process counts as one that does not end. Callers give it work of hours.
_PATIENCE = 120


class Ended(NamedTuple):
    """Exit status of a process, and its output after its work had begun."""

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
            raise AssertionError("the process continues after Ctrl-C") from None
        finally:
            process.kill()
    return Ended(process.returncode, output, errors)


def train_despite_kills(command: Sequence[str], out: Path, signs: Sequence[str]) -> None:
    """Run a training into `out` on one thread, killed when each file of `signs` appears, and at last to its end."""
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    for sign in signs:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=env)
        while not (out / sign).exists():
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
        process.wait()
        assert not (out / "evaluate.json").exists()
    subprocess.run(command, check=True, env=env, stdout=subprocess.DEVNULL)
