"""Servers in separate processes, for programs that measure or attack them."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.request import urlopen


@dataclass
class Served:
    """A running server, and its address."""

    process: "subprocess.Popen[str]"
    url: str

    def memory(self) -> float:
        """Return the resident memory, MiB."""
        match = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{self.process.pid}/status").read_text())
        return float(match[1]) / 1024 if match else float("nan")

    def settled(self, gauge: str, value: int) -> int:
        """Wait at most 20 s until one of its gauges has a value; returns it."""
        until = time.monotonic() + 20.0
        while True:
            with urlopen(f"{self.url.replace('ws', 'http', 1)}/metrics") as answer:
                match = re.search(rf"^graspbox_{gauge} (\d+)", answer.read().decode(), re.MULTILINE)
            if match is not None and (int(match[1]) <= value or time.monotonic() > until):
                return int(match[1])
            time.sleep(0.2)


@contextmanager
def served(*options: str, command: str = "serve") -> Iterator[Served]:
    """Run a server at any free port."""
    call = [sys.executable, "-m", "graspbox", command, *options, "--port", "0"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        match = re.search(r"wss?://\S+?:\d+", process.stdout.readline())
        assert match is not None, "the server did not start"
        try:
            yield Served(process, match[0])
        finally:
            process.terminate()
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
