"""Servers in separate processes, for programs that measure or attack them."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Served:
    """A running server, and its address."""

    process: "subprocess.Popen[str]"
    url: str

    def memory(self) -> float:
        """Return the resident memory, MiB."""
        found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{self.process.pid}/status").read_text())
        return float(found[1]) / 1024 if found else float("nan")


@contextmanager
def served(*options: str, command: str = "serve") -> Iterator[Served]:
    """Run a server at any free port."""
    call = [sys.executable, "-m", "graspbox", command, *options, "--port", "0"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"wss?://\S+?:\d+", process.stdout.readline())
        assert found is not None, "the server did not start"
        try:
            yield Served(process, found[0])
        finally:
            process.terminate()
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
