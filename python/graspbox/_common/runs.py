"""Run directories, resumable after an interruption: trainings, their stages, their results.

| file | contents |
|---|---|
| ``settings.json`` | settings that determine the results; a run with other settings is refused |
| ``log.txt``       | lines with the time |
| ``clock.json``    | seconds of work so far, including those before interruptions |
| ``NAME.jsonl``    | rows of results, each flushed to disk before work continues |
| ``NAME.json``     | results of the stage ``NAME``, whose folder is ``NAME`` |

One process at a time works in a directory. Data sets and demonstrations keep their settings in their manifests, and
share `refuse_changes` and the lock (`graspbox._common.files.locked`).
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from graspbox._common.files import dumps, locked, write_text
from graspbox._common.progress import shown_time
from graspbox.errors import ConfigError

__all__ = ["Rows", "Run", "changes", "read_settings", "refuse", "refuse_changes"]

_SETTINGS, _CLOCK, _LOG = "settings.json", "clock.json", "log.txt"
#: Files of a directory without results yet.
_NOTHING_MADE = {_SETTINGS, _CLOCK, _LOG, ".lock", "tensorboard"}
#: Least time between two lines of progress, and between two records of the clock, seconds.
_EVERY = 10.0
#: Share of the work, and number of lines of progress, from which on the remaining time is estimated.
_MEASURED, _LINES = 0.01, 3
#: Differences listed by a refusal.
_NAMED = 3


class Run:
    """A run in a directory, which is continued; a context manager, which keeps other processes out.

    Parameters
    ----------
    settings : mapping, optional
        Settings that determine the results, as JSON holds them; not time limits, since a run continues with more time.
    growing : mapping of str to tuple of str
        Settings, by paths with dots, that may be greater than before; and the stages that are then done again, as
        patterns such as "evaluate*". Their earlier results move to the folder ``with-VALUE-NAME``.
    resume : bool
        If false, the directory must not have a run.
    limit : float
        Seconds that the work may take, including those before interruptions.
    echo : callable
        Shows each line of the log.
    """

    def __init__(
        self,
        folder: Path,
        settings: Mapping[str, Any] | None = None,
        *,
        growing: Mapping[str, tuple[str, ...]] | None = None,
        resume: bool = True,
        limit: float = float("inf"),
        echo: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.folder, self.limit = Path(folder), limit
        self._settings, self._growing, self._resume, self._echo = settings, growing or {}, resume, echo
        self._parent: Run | None = None
        #: Results of the stages that are done, by name.
        self.stages: dict[str, dict[str, Any]] = {}
        self._opened = ExitStack()
        self._before, self._began, self._recorded, self._reported = 0.0, time.monotonic(), 0.0, -_EVERY
        #: Times at which progress was logged, and the shares of the work done by then.
        self._marks: list[tuple[float, float]] = []

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(locked(self.folder))
            made = {path.name for path in self.folder.iterdir()} - _NOTHING_MADE
            path = self.folder / _SETTINGS
            if made and path.exists():
                if not self._resume:
                    raise ConfigError(f"{str(self.folder)!r} holds a run; resume it, or name another folder")
                self._grow(read_settings(self.folder))
            text = dumps(json.loads(json.dumps(self._settings or {}))) + "\n"
            if not made and not (path.exists() and path.read_bytes() == text.encode()):
                # The clock of a run with other settings does not apply.
                (self.folder / _CLOCK).unlink(missing_ok=True)
            write_text(path, text)
            self._start()
            self._opened = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.record()
        self._opened.close()

    def _grow(self, before: dict[str, Any]) -> None:
        """Refuse other settings than before, except greater ones of those that may grow."""
        now = json.loads(json.dumps(self._settings or {}))
        grown: dict[str, Any] = {}
        for path in self._growing:
            *outer, name = path.split(".")
            old, new = _inner(before, outer), _inner(now, outer)
            if _is_greater(new.get(name), old.get(name)):
                grown[path], old[name] = old[name], new[name]
        refuse_changes(self.folder, before, now)
        for path, value in grown.items():
            aside = self.folder / f"with-{value}-{path.rpartition('.')[2]}"
            for pattern in self._growing[path]:
                for done in sorted(self.folder.glob(pattern)):
                    aside.mkdir(exist_ok=True)
                    done.replace(aside / done.name)

    def _start(self) -> None:
        """Start the clock where an earlier process left it."""
        clock = self.folder / _CLOCK
        self._before = float(json.loads(clock.read_text())) if clock.exists() else 0.0
        self._began = time.monotonic()

    @property
    def seconds(self) -> float:
        """Time taken so far."""
        return self._before + time.monotonic() - self._began

    def late(self) -> bool:
        """Return whether the limit is reached; called often, it also records the time taken."""
        now = time.monotonic() - self._began
        if now - self._recorded > _EVERY:
            self._recorded = now
            self.record()
        return self.seconds >= self.limit

    def record(self) -> None:
        """Save the time taken, for the process that resumes the run."""
        write_text(self.folder / _CLOCK, f"{self.seconds:.1f}\n")

    def log(self, line: str) -> None:
        """Add a line to the log, with the time; a stage adds to the log of its run."""
        if self._parent is not None:
            self._parent.log(f"{self.folder.name}: {line}")
            return
        stamped = f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} {line}"
        with (self.folder / _LOG).open("a") as file:
            file.write(stamped + "\n")
        self._echo(stamped)

    def report(self, text: str, share: float) -> None:
        """Log progress such as "40 of 100 scenes" every 10 seconds, with the remaining time; saves the time taken.

        `share` of the work is done, 0 to 1; a smaller one than before belongs to other work. The remaining time follows
        from the pace of the second half of the lines and from the limit; before three lines it is not known.
        """
        now = time.monotonic() - self._began
        if now - self._reported < _EVERY:
            return
        self._reported = now
        self.record()
        left = min(self._left(now, share), max(0.0, self.limit - self.seconds))
        known = "" if left == float("inf") else f", {shown_time(left)} left"
        self.log(f"{text}; {shown_time(self.seconds)} taken{known}")

    def _left(self, now: float, share: float) -> float:
        """Estimate the time to the end of the work, seconds; infinity if it is not known yet."""
        if self._marks and share < self._marks[-1][1]:
            self._marks.clear()
        self._marks.append((now, share))
        # Preparation, and work before this run, are no part of the pace.
        then, before = self._marks[len(self._marks) // 2]
        if len(self._marks) < _LINES or share < _MEASURED or share <= before:
            return float("inf")
        return (1.0 - share) * (now - then) / (share - before)

    def counter(self, total: int, things: str) -> Callable[[int], None]:
        """Return a function that reports the number of things done."""
        return lambda done: self.report(f"{done} of {total} {things}", done / max(total, 1))

    def rows(self, name: str) -> "Rows":
        """Open the rows ``NAME.jsonl``."""
        return Rows(self.folder / f"{name}.jsonl")

    def stage(self, name: str, limit: float, work: "Callable[[Run], Mapping[str, Any]]") -> dict[str, Any]:
        """Run a stage of at most `limit` seconds unless it is done, and return its results, with ``seconds``.

        `work` gets a run in the folder of the name, and returns results that JSON can hold.
        """
        path = self.folder / f"{name}.json"
        if path.exists():
            results: dict[str, Any] = json.loads(path.read_text())
            self.log(f"{name}: done by an earlier run, in {shown_time(results['seconds'])}")
            return self.stages.setdefault(name, results)
        stage = Run(self.folder / name, limit=limit)
        stage.folder.mkdir(exist_ok=True)
        stage._parent = self
        stage._start()
        self.log(f"{name}: begins, at most {shown_time(limit)}")
        made = work(stage)
        stage.record()
        text = dumps({"seconds": round(stage.seconds, 1), **made}) + "\n"
        write_text(path, text)
        self.log(f"{name}: done after {shown_time(stage.seconds)}; {json.dumps(json.loads(text))}")
        # As the next run will read them.
        return self.stages.setdefault(name, json.loads(text))


class Rows(list[dict[str, Any]]):
    """Rows of JSON in a file; `append` flushes each to disk. An incomplete last line of an interruption is removed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        content = path.read_bytes() if path.exists() else b""
        whole = content[: content.rfind(b"\n") + 1]
        try:
            super().__init__(dict(json.loads(line)) for line in whole.splitlines())
        except (ValueError, TypeError):
            raise ConfigError(f"{str(path)!r} has no rows of a run; name another folder") from None
        if len(whole) < len(content):
            os.truncate(path, len(whole))

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row to the disk."""
        with self.path.open("a") as file:
            file.write(json.dumps(row, allow_nan=False) + "\n")
            file.flush()
            os.fsync(file.fileno())
        super().append(dict(row))

    def keep(self, worth: Callable[[dict[str, Any]], bool]) -> None:
        """Keep some rows, such as those up to the checkpoint from which a run resumes."""
        kept = [row for row in self if worth(row)]
        if len(kept) < len(self):
            write_text(self.path, "".join(json.dumps(row) + "\n" for row in kept))
            self[:] = kept


def read_settings(folder: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the settings of a run from its directory; a `ConfigError` says that there is no run."""
    try:
        return dict(json.loads((Path(folder) / _SETTINGS).read_text()))
    except (OSError, ValueError, TypeError):
        raise ConfigError(f"there is no run in {os.fspath(folder)!r}: it has no readable {_SETTINGS}") from None


def refuse_changes(place: str | os.PathLike[str], before: Any, now: Any, advice: str = "name another folder") -> None:
    """Refuse to continue a run, a data set or a file with settings, as JSON holds them, other than it was begun with.

    The `ConfigError` has the first three fields that differ, with both values, and ends with `advice`.
    """
    refuse(place, list(changes(*(json.loads(json.dumps(settings)) for settings in (before, now)))), advice)


def refuse(place: str | os.PathLike[str], differing: Sequence[str], advice: str = "name another folder") -> None:
    """Refuse to continue where settings differ, with the first three differences; do nothing where there are none."""
    if differing:
        more = f"; and {len(differing) - _NAMED} more" if len(differing) > _NAMED else ""
        shown = "; ".join(differing[:_NAMED])
        raise ConfigError(f"{os.fspath(place)!r} was begun with other settings: {shown}{more}; {advice}")


def changes(before: Any, now: Any, name: str = "") -> Iterator[str]:
    """List the differences between two settings; nested fields are named by paths with dots."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in {**before, **now}:
            yield from changes(before.get(key, _ABSENT), now.get(key, _ABSENT), f"{name}.{key}" if name else key)
    elif isinstance(now, dict) and now:
        yield from changes({}, now, name)
    elif before != now:
        yield f"{name} was {before!r}, is now {now!r}"


def _inner(settings: dict[str, Any], path: Sequence[str]) -> dict[str, Any]:
    """Return the settings at a path; new ones if there are none."""
    for name in path:
        inner = settings.get(name)
        settings = inner if isinstance(inner, dict) else {}
    return settings


def _is_greater(now: Any, before: Any) -> bool:
    return isinstance(now, int | float) and isinstance(before, int | float) and now > before


class _Absent:
    def __repr__(self) -> str:
        return "absent"


_ABSENT = _Absent()
