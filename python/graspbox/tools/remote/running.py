"""Running servers: threads that answer requests that need Python, draining, shutdown."""

import ctypes
import threading
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Self

from graspbox import _core

__all__ = ["DRAIN", "PAUSE", "RunningServer"]

#: Seconds granted to running calls when a server stops.
DRAIN = 10.0
#: Seconds for which a thread waits for a request before it checks whether the server has stopped.
PAUSE = 0.25
#: Seconds that an idle thread needs to end.
_JOIN = 2.0
#: Seconds between returns of free memory: a millisecond if there is little, 15 ms for 100 MB.
_TRIM = 10.0


def _trim_memory() -> None:
    """Return the memory of ended sessions to the system, which glibc keeps; other C libraries have no such function."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


class RunningServer(ABC):
    """A server that runs until `stop`; also a context manager. `secure`: clients connect with TLS."""

    def __init__(self, core: "_core.Listener", secure: bool, threads: int) -> None:
        self._listener, self._scheme = core, "wss" if secure else "ws"
        # Plain flags: a signal handler may set them in the middle of anything.
        self._draining = self._hurried = self._stopped = False
        self._trim_at = time.monotonic() + _TRIM
        self._workers = [
            threading.Thread(target=self._answer_all, name=f"{type(self).__name__}-{index}", daemon=True)
            for index in range(threads)
        ]

    @property
    def url(self) -> str:
        """Address for clients."""
        host, port = self._listener.address
        return f"{self._scheme}://{f'[{host}]' if ':' in host else host}:{port}"

    def metrics(self) -> str:
        """Return the counters, in the text format of OpenMetrics."""
        return self._listener.metrics()

    def start(self) -> Self:
        """Start the threads that answer clients."""
        for worker in self._workers:
            worker.start()
        return self

    def wait(self) -> None:
        """Wait until `drain` or `stop` is called, from a signal handler or another thread."""
        while not self._draining:
            time.sleep(PAUSE)

    def drain(self) -> None:
        """Stop accepting sessions and end `wait`. A signal handler may call it."""
        self._draining = True
        self._listener.drain()

    def hurry(self) -> None:
        """Make `stop` return without waiting. A signal handler may call it."""
        self._hurried = True

    def stop(self, patient: bool = True) -> bool:
        """End all sessions, after running calls (10 s at most) unless `patient` is false; return whether all ended."""
        self.drain()
        # Not in the core: a second signal must be noticed while it waits.
        until = time.monotonic() + DRAIN
        while patient and self._listener.busy and not self._hurried and time.monotonic() < until:
            time.sleep(0.01)
        idle = not self._listener.busy
        self._stopped = True
        self._listener.stop()
        for worker in self._workers:
            if worker.is_alive():
                worker.join(_JOIN if idle else 0.0)
        return idle and not any(worker.is_alive() for worker in self._workers)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _answer_all(self) -> None:
        while not self._stopped:
            self._answer_next()
            if time.monotonic() >= self._trim_at:
                self._trim_at = time.monotonic() + _TRIM
                _trim_memory()

    @abstractmethod
    def _answer_next(self) -> None:
        """Answer the next request, if one comes within `PAUSE`."""
