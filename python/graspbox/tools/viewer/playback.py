"""`Playback`: a time slider, and a button that plays it."""

import threading
import time
from collections.abc import Callable

from graspbox.tools.viewer.canvas import Canvas

#: Frames per second while it plays, and seconds between moves of the slider.
_RATE, _SLIDER_PERIOD = 30.0, 0.2


class Playback:
    """A slider over samples, a button that plays them, and a speed, in the present folder of the page.

    Parameters
    ----------
    canvas : Canvas
        The page.
    draw : callable
        Shows a sample.
    period : float
        Time from a sample to the next one, seconds.
    """

    def __init__(self, canvas: Canvas, draw: Callable[[int], None], period: float) -> None:
        self._canvas, self._draw, self._period = canvas, draw, period
        self._count, self._plays = 0, threading.Event()
        gui = canvas.gui
        hint = f"one sample per {1000 * period:g} ms"
        self.slider = gui.add_slider("sample", 0, 1, 1, 0, disabled=True, hint=hint)
        self.play = gui.add_button("play", icon="player-play", disabled=True)
        self.speed = gui.add_dropdown("speed", ("1", "0.5", "0.25", "0.1"), initial_value="1")
        canvas.on(self.slider, call=self._moved)
        canvas.on(self.play, call=self.toggle)

    @property
    def plays(self) -> bool:
        """Whether it plays."""
        return self._plays.is_set()

    def load(self, count: int) -> None:
        """Take a number of samples, and show the first one; 0 for none."""
        self.stop()
        with self._canvas.lock:
            self._count = count
            self.play.disabled = self.slider.disabled = not count
            if count:
                self.slider.max = max(count - 1, 1)
                self.seek(0)

    def seek(self, sample: int) -> None:
        """Show a sample."""
        with self._canvas.lock:
            if self.slider.value == sample:
                self._moved()
            else:
                self.slider.value = sample  # calls `_moved`

    def _moved(self) -> None:
        if self._count:
            self._draw(min(int(self.slider.value), self._count - 1))

    def toggle(self) -> None:
        """Play from the present sample, or from the beginning at the end; stop if it plays."""
        if self.plays:
            self.stop()
        elif self._count:
            if self.slider.value >= self._count - 1:
                self.seek(0)
            self._plays.set()
            self.play.label = "stop"
            self._canvas.thread(self._run, "player")

    def stop(self) -> None:
        """Stop playing."""
        self._plays.clear()

    def _run(self) -> None:
        count, first = self._count, int(self.slider.value)
        began, sent = time.monotonic(), 0.0
        while self.plays and not self._canvas.closed.is_set() and count == self._count:
            now = time.monotonic()
            sample = min(first + int((now - began) * float(self.speed.value) / self._period), count - 1)
            last = sample == count - 1
            with self._canvas.lock:
                if now - sent > _SLIDER_PERIOD or last:
                    sent = now
                    self.seek(sample)
                else:
                    self._draw(sample)
            if last:
                break
            self._canvas.closed.wait(1.0 / _RATE)
        self._plays.clear()
        self.play.label = "play"
