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
        #: Number of samples, and the present run of the button, if it plays.
        self._count = 0
        self._run: threading.Event | None = None
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
        return self._run is not None

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
            self._run = run = threading.Event()
            self.play.label = "stop"
            self._canvas.thread(lambda: self._plays(run), "player")

    def stop(self) -> None:
        """Stop playing."""
        with self._canvas.lock:
            self._run = None
            self.play.label = "play"

    def _plays(self, run: threading.Event) -> None:
        first, began, sent = int(self.slider.value), time.monotonic(), 0.0
        while not self._canvas.closed.is_set():
            now = time.monotonic()
            with self._canvas.lock:
                # Meanwhile it may have been stopped, or got other samples.
                if self._run is not run:
                    return
                passed = int((now - began) * float(self.speed.value) / self._period)
                sample = min(first + passed, self._count - 1)
                if now - sent > _SLIDER_PERIOD or sample == self._count - 1:
                    sent = now
                    self.seek(sample)
                else:
                    self._draw(sample)
                if sample == self._count - 1:
                    self.stop()
                    return
            self._canvas.closed.wait(1.0 / _RATE)
