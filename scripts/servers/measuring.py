"""Figures of a benchmark: arguments, rows, and runs that alternate with their rivals."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass
class Args:
    """Measurements."""

    only: tuple[str, ...] = ()
    """Parts: steps, calls, clients, memory, policy, acting. All by default."""
    runs: int = 5
    """Runs of each figure."""
    policy: str = ""
    """Folder of a policy, for the parts policy and acting."""
    peer_python: tuple[str, ...] = ()
    """Interpreters with installed peers, besides this one."""
    json: Path | None = None
    """Write the figures into this file."""
    rows: list[dict[str, Any]] = field(default_factory=list, init=False)

    def add(self, work: str, values: list[float], unit: str, **more: float) -> None:
        """Add a row, and print it."""
        row = {"work": work, "median": float(np.median(values)), "unit": unit, "count": len(values), **more}
        self.rows.append(row)
        extra = "".join(f"  {name} {value:.3g}" for name, value in more.items())
        print(f"{work:<60} {row['median']:>10.4g} {unit}{extra}", flush=True)

    def compare(self, label: str, work: dict[str, Callable[[], float]]) -> None:
        """Run each in turn, and add a row for each, with its ratio to the first."""
        measured: dict[str, list[float]] = {name: [] for name in work}
        for one in work.values():
            one()  # to warm up
        for _ in range(self.runs):
            for name, one in work.items():
                measured[name].append(one())
        first = np.array(next(iter(measured.values())))
        for name, rates in measured.items():
            self.add(f"{label}: {name}", rates, "1/s", ratio=float(np.median(np.array(rates) / first)))


def at_once(ask: Callable[[Any, int], None], clients: Sequence[Any], count: int) -> float:
    """Let clients share a number of requests, each in its own thread; returns requests per second."""
    each = count // len(clients)
    threads = [threading.Thread(target=ask, args=(client, each)) for client in clients]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return count / (time.perf_counter() - started)
