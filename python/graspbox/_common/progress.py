"""A progress bar on standard error without dependencies, and formatted times."""

import sys
import time
from types import TracebackType

__all__ = ["ProgressBar", "shown_time"]

#: Characters of the bar.
_WIDTH = 30


def shown_time(seconds: float) -> str:
    """Format a time as ``2:05:09``, or ``-`` if it is unknown (infinite)."""
    if seconds == float("inf"):
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


class ProgressBar:
    """Shows progress over `total` steps: one updated line on a terminal, ten lines in a log file.

    The bar appears after `delay` seconds, if `shown`.
    """

    def __init__(self, task: str, total: int, shown: bool = True, delay: float = 0.0) -> None:
        self._task, self._total, self._shown = task, total, shown
        self._written = False
        self._tenth, self._begins = 0, time.monotonic() + delay

    def update(self, done: int) -> None:
        """Show that `done` steps are complete."""
        if not self._shown or time.monotonic() < self._begins:
            return
        self._written = True
        share = done / max(1, self._total)
        bar = "#" * int(share * _WIDTH)
        line = f"{self._task} [{bar:<{_WIDTH}}] {done}/{self._total}"
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{line}")
        elif int(share * 10) > self._tenth:
            self._tenth = int(share * 10)
            sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    def __enter__(self) -> "ProgressBar":
        self.update(0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._written and sys.stderr.isatty():
            sys.stderr.write("\n")
