"""The folder of a run: settings, the end of the log, results of stages, and curves; read again as it grows."""

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError
from graspbox.viewer.page import Page
from graspbox.viewer.tables import html_table

__all__ = ["RunPage", "is_run"]

#: Seconds between checks of the folder.
_PERIOD = 2.0
#: Largest file of rows, and the part of the log that is shown, bytes.
_MAX_ROWS, _LOG_END = 256 << 20, 2000
#: Columns along which curves are drawn, the first that a file has.
_ALONG = ("step", "steps", "seconds")
_SETTINGS, _LOG = "settings.json", "log.txt"


def is_run(folder: Path) -> bool:
    """Return whether a folder is that of a run: it has settings, and a log or rows."""
    return (folder / _SETTINGS).is_file() and ((folder / _LOG).is_file() or any(folder.rglob("*.jsonl")))


class RunPage(Page):
    """Page of a run; `content` is its folder."""

    title: ClassVar[str] = "run"

    def build(self) -> None:
        """Show settings, log and the first curve."""
        gui, folder = self.canvas.gui, self.content
        self.canvas.say(f"**{folder}**")
        self.files = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*.jsonl"))}
        self._curves = gui.add_folder("Curves")
        with self._curves:
            self.file = gui.add_dropdown("rows", tuple(self.files) or ("none",), disabled=not self.files)
            self.column = gui.add_dropdown("column", ("none",))
            self.plot: Any = None
            self.last = gui.add_markdown("")
        with gui.add_folder("Results"):
            self.results = gui.add_html("")
        with gui.add_folder("Settings", expand_by_default=False):
            gui.add_html(html_table(("setting", "value"), list(_flat(_json(folder / _SETTINGS)))))
        with gui.add_folder("Log"):
            self.log = gui.add_markdown("")
        self.canvas.on(self.file, call=self._choose)
        self.canvas.on(self.column, call=self.refresh)
        self._seen: tuple[Any, ...] = ()
        self._choose()
        self.canvas.thread(self._watch, "run")

    def _watch(self) -> None:
        while not self.canvas.closed.wait(_PERIOD):
            self.check()

    def check(self) -> bool:
        """Read the folder again if a file has grown; return whether one has."""
        paths = [*self.files.values(), *self.content.glob("*.json"), self.content / _LOG]
        seen = tuple((str(path), path.stat().st_size) for path in paths if path.is_file())
        if seen == self._seen:
            return False
        self._seen = seen
        with self.canvas.lock:
            self.refresh()
        return True

    def rows(self) -> list[dict[str, Any]]:
        """Read the rows of the chosen file; an incomplete last line is left out."""
        path = self.files.get(str(self.file.value))
        if path is None:
            return []
        content = read_bounded(path, _MAX_ROWS)
        try:
            found = [json.loads(line) for line in content[: content.rfind(b"\n") + 1].splitlines()]
        except ValueError:
            raise ConfigError(
                f"{str(path)!r} has a line that is not JSON; choose another file, or remove the line"
            ) from None
        return [row for row in found if isinstance(row, dict)]

    def _choose(self) -> None:
        """Offer the columns of the chosen file."""
        rows = self.rows()
        names = dict.fromkeys(name for row in rows for name, value in row.items() if _is_number(value))
        self.column.options = tuple(name for name in names if name not in _ALONG) or ("none",)
        self.refresh()

    def curve(self) -> tuple[Any, Any]:
        """Return places and values of the chosen column, (n,) each."""
        name, rows = str(self.column.value), self.rows()
        rows = [row for row in rows if _is_number(row.get(name))]
        along = next((key for key in _ALONG if rows and all(_is_number(row.get(key)) for row in rows)), None)
        places = [float(index if along is None else row[along]) for index, row in enumerate(rows)]
        return np.array(places), np.array([float(row[name]) for row in rows])

    def refresh(self) -> None:
        """Draw the chosen curve, and show results and log."""
        places, values = self.curve()
        if self.plot is not None:
            self.plot.remove()
            self.plot = None
        if len(values) > 1:
            import viser.uplot

            series = (
                viser.uplot.Series(label="step"),
                viser.uplot.Series(label=str(self.column.value), stroke="#0072b2", width=2),
            )
            scales = {"x": viser.uplot.Scale(time=False, auto=True), "y": viser.uplot.Scale(auto=True)}
            with self._curves:
                self.plot = self.canvas.gui.add_uplot((places, values), series, scales=scales, aspect=1.4)
        self.last.content = f"{len(values)} rows; last {values[-1]:.5g}" if len(values) else "no rows yet"
        stages = [(path.stem, _json(path)) for path in sorted(self.content.glob("*.json")) if path.name != _SETTINGS]
        lines = [(name, key, value) for name, found in stages for key, value in _flat(found)]
        self.results.content = html_table(("stage", "result", "value"), lines[:200])
        log = self.content / _LOG
        text = log.read_bytes()[-_LOG_END:].decode(errors="replace") if log.is_file() else ""
        self.log.content = "```\n" + text.replace("```", "'''") + "\n```"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _json(path: Path) -> Any:
    """Read a JSON file; one that is being written counts as empty."""
    try:
        return json.loads(read_bounded(path, _MAX_ROWS))
    except ValueError:
        return {}


def _flat(value: Any, name: str = "") -> Any:
    """List the leaves of nested settings with their paths."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    else:
        text = json.dumps(value)
        yield name or "value", text if len(text) < 80 else text[:77] + "..."
