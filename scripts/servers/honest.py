"""An honest client in a separate process, whose round trips show the effect of an attack on the server.

This file is also the client's program: it steps an environment, or queries a policy, until its standard input ends, and
prints its round trips, milliseconds, as JSON.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/python"))

from hostile_attacks import ACTION, made

#: Seconds between two calls.
NAP = 0.003


class Honest:
    """The running client."""

    def __init__(self, url: str, kind: str) -> None:
        command = [sys.executable, __file__, url, kind]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def end(self) -> list[float]:
        """Stop it and return its round trips, milliseconds."""
        try:
            out, _ = self.process.communicate("\n", timeout=60)
            return [float(x) for x in json.loads(out)]
        except (subprocess.TimeoutExpired, ValueError):
            self.process.kill()
            return []


def asking(url: str) -> Callable[[], None]:
    """Return a call that queries a policy for a decision."""
    from graspbox import _core

    client: Any = _core.PolicyClient(url, token=None, ca=None)

    def ask() -> None:
        client.send({"depth": np.zeros((1, 1), np.float32), "intrinsics": np.eye(3)})
        client.receive()

    return ask


def stepping(url: str) -> Callable[[], None]:
    """Return a call that steps an environment."""
    peer = made(url, keywords={"control_freq": 20, "max_episode_steps": 1_000_000})
    actions = np.zeros((1, ACTION), np.float32)

    def step() -> None:
        answer = peer.call("step", actions=actions)
        assert "error" not in answer, answer

    return step


def main(url: str, kind: str) -> None:
    """Call until standard input ends, an hour at most."""
    call, times, until = (asking if kind == "policy" else stepping)(url), [], time.monotonic() + 3600.0
    print("ready", flush=True)
    os.set_blocking(0, False)
    while time.monotonic() < until and sys.stdin.buffer.raw.read(1) is None:  # type: ignore[attr-defined]
        started = time.perf_counter()
        call()
        times.append(1e3 * (time.perf_counter() - started))
        time.sleep(NAP)
    print(json.dumps(times), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
