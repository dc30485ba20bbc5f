"""A long run in stages: each has a time limit, is logged with its progress, and is continued after an interruption.

A run has a folder: ``settings.json``, ``log.txt``, and for each stage a folder of its own and, once it is over,
``NAME.json`` with its results.
"""

import json
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from graspbox.errors import ConfigError
from graspbox.files import dumps, locked, write_text
from graspbox.progress import shown_time

__all__ = ["Run", "Stage"]

#: Least time between two lines of progress, and between two records of the time taken, seconds.
_EVERY = 10.0


class Stage:
    """One stage at work.

    Attributes
    ----------
    folder : Path
        Its folder.
    limit : float
        Seconds that it may take, those before interruptions included.
    """

    def __init__(self, name: str, folder: Path, limit: float, log: Callable[[str], None]) -> None:
        self.name, self.folder, self.limit, self._log = name, folder, limit, log
        folder.mkdir(parents=True, exist_ok=True)
        self._clock = folder / "seconds.json"
        self._before = float(json.loads(self._clock.read_text())) if self._clock.exists() else 0.0
        self._began, self._recorded, self._told = time.monotonic(), 0.0, -_EVERY

    @property
    def seconds(self) -> float:
        """Time taken so far."""
        return self._before + time.monotonic() - self._began

    def late(self) -> bool:
        """Tell whether the limit is reached; called often, it also records the time taken."""
        now = time.monotonic() - self._began
        if now - self._recorded > _EVERY:
            self._recorded = now
            self.record()
        return self.seconds >= self.limit

    def record(self) -> None:
        """Write down the time taken, for the next run after an interruption."""
        write_text(self._clock, f"{self.seconds:.1f}\n")

    def report(self, text: str, share: float, remaining: float | None = None) -> None:
        """Log progress, now and then: what is done, and the time that is left; records the time taken.

        Parameters
        ----------
        text : str
            What is done.
        share : float
            How much of the work that is, 0 to 1; the limit may end it before.
        remaining : float, optional
            Expected time to the end, seconds; by default from the share and the limit.
        """
        now = time.monotonic() - self._began
        if now - self._told < _EVERY:
            return
        self._told = now
        self.record()
        if remaining is None:
            remaining = self.seconds * (1.0 / share - 1.0) if share > 0 else float("inf")
        left = min(remaining, max(0.0, self.limit - self.seconds))
        self._log(f"{self.name}: {text}; {shown_time(self.seconds)} taken, {shown_time(left)} left")


class Run:
    """A run in a folder.

    Parameters
    ----------
    folder : Path
        The folder; a run that was interrupted is continued.
    settings : mapping
        What the results depend on; limits of time do not belong here, so that more time continues a run.
    echo : callable
        Shows each line of the log.

    Raises
    ------
    ConfigError
        If the folder holds a run with other settings.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any], echo: Callable[[str], None] = print) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._echo = folder, echo
        path, text = folder / "settings.json", dumps(dict(settings)) + "\n"
        if path.exists() and path.read_text() != text:
            before = json.loads(path.read_text())
            differing = sorted(k for k in {*before, *settings} if before.get(k) != json.loads(text).get(k))
            raise ConfigError(f"{folder} holds a run with another {', '.join(differing)}; name another folder")
        write_text(path, text)

    def log(self, line: str) -> None:
        """Add a line to the log, with the time."""
        stamped = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} {line}"
        with (self.folder / "log.txt").open("a") as file:
            file.write(stamped + "\n")
        self._echo(stamped)

    def stage(self, name: str, limit: float, work: Callable[[Stage], Mapping[str, Any]]) -> dict[str, Any]:
        """Do a stage unless it is over, and give its results, with ``seconds``.

        Parameters
        ----------
        name : str
            Its name; no other stage of the run has it.
        limit : float
            Seconds that it may take.
        work : callable
            Does it, and gives results that JSON can hold.

        Raises
        ------
        ConfigError
            If another process is at work in the folder.
        """
        path = self.folder / f"{name}.json"
        if path.exists():
            found: dict[str, Any] = json.loads(path.read_text())
            self.log(f"{name}: over since an earlier run, {shown_time(found['seconds'])}")
            return found
        with locked(self.folder):
            self.log(f"{name}: begins, at most {shown_time(limit)}")
            stage = Stage(name, self.folder / name, limit, self.log)
            made = work(stage)
            results = {"seconds": round(stage.seconds, 1), **made}
            stage.record()
            write_text(path, dumps(results) + "\n")
        self.log(f"{name}: over after {shown_time(stage.seconds)}; {json.dumps(results)}")
        # As the next run will read them.
        read: dict[str, Any] = json.loads(path.read_text())
        return read
