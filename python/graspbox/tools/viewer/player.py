"""`Player`: the trace of a trial on a time slider, with the hand's joints, contacts and tactile values."""

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from graspbox.simulation.outcomes import Trace
from graspbox.tools.hand_links import HandLinks
from graspbox.tools.viewer.canvas import Canvas
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import FAILURE, ramp

#: Frames per second while a trace plays.
_RATE = 30.0
#: Length of a force arrow, metres per N, and its bounds, metres.
_LENGTH, _SHORTEST, _LONGEST = 0.005, 0.01, 0.08
#: Seconds between changes of the readings while a trace plays, and a change of place that is not sent, metres.
_READING_PERIOD, _STILL = 0.2, 2e-4
#: Radius of a sensor in the scene, metres, and the force that has the last colour, N.
_SENSOR, _FULL = 0.0028, 5.0


class Player:
    """Plays traces of trials; moves the hand, the node of the scene's object, and those of `graspbox.Scene.others`."""

    def __init__(self, canvas: Canvas, hand: DrawnHand, node: Any, others: Sequence[Any] = ()) -> None:
        self._canvas, self._hand, self._nodes = canvas, hand, (node, *others)
        self._links = HandLinks(hand.hand)
        self.trace: Trace | None = None
        self._plays, self._read_at = threading.Event(), 0.0
        gui = canvas.gui
        with gui.add_folder("Time"):
            self.slider = gui.add_slider("sample", 0, 1, 1, 0, disabled=True, hint="one sample per 10 ms")
            self.play = gui.add_button("play", icon="player-play", disabled=True)
            self.speed = gui.add_dropdown("speed", ("1", "0.5", "0.25", "0.1"), initial_value="1")
            self.with_contacts = gui.add_checkbox("contacts", True, hint="forces on the object, and tactile sensors")
            self.readings = gui.add_markdown("")
        self.arrows = canvas.scene.add_arrows(
            "/contacts",
            np.zeros((1, 2, 3), dtype=np.float32),
            FAILURE,
            shaft_radius=0.0012,
            head_radius=0.003,
            head_length=0.006,
            visible=False,
        )
        self.sensors: Any = None
        if count := len(self._links.sensor_links):
            path, grey = f"{hand.name}/sensors", np.full((count, 3), 150, dtype=np.uint8)
            self.sensors = canvas.spheres(path, _SENSOR, np.zeros((count, 3)), grey, visible=False)
        canvas.on(self.slider, self.with_contacts, call=self._moved)
        canvas.on(self.play, call=self.toggle)

    def load(self, trace: Trace) -> None:
        """Load a trace, and show its first sample; an empty one shows nothing."""
        self.clear()
        if not len(trace.time):
            return
        with self._canvas.lock:
            self.trace = trace
            self.play.disabled = self.slider.disabled = False
            self.slider.max = max(len(trace.time) - 1, 1)
            self.seek(0)

    def clear(self) -> None:
        """Forget the trace, and hide its contacts."""
        self.stop()
        with self._canvas.lock:
            self.trace = None
            self.play.disabled = self.slider.disabled = True
            self._hide()

    def _hide(self) -> None:
        self.readings.content = ""
        for node in (self.arrows, self.sensors):
            if node is not None:
                node.visible = False

    def seek(self, sample: int) -> None:
        """Show a sample of the trace."""
        with self._canvas.lock:
            if self.slider.value == sample:
                self._moved()
            else:
                self.slider.value = sample  # calls `_moved`

    def _moved(self) -> None:
        if self.trace is not None:
            self._draw(self.trace, min(int(self.slider.value), len(self.trace.time) - 1))

    def _draw(self, trace: Trace, sample: int) -> None:
        with self._canvas.server.atomic():
            self._hand.pose(trace.world_from_hand[sample], trace.joints[sample])
            poses = (trace.world_from_object[sample], *trace.world_from_others[sample])
            for node, pose in zip(self._nodes, poses, strict=True):
                self._canvas.move(node, pose)
            if self.with_contacts.value:
                self._draw_contacts(trace, sample)
            else:
                self._hide()
        # While a trace plays, readings change at a lower rate.
        now = time.monotonic()
        if not self._plays.is_set() or now - self._read_at > _READING_PERIOD:
            self._read_at = now
            self.readings.content = self._text(trace, sample)

    def _draw_contacts(self, trace: Trace, sample: int) -> None:
        rows = trace.contacts(sample)
        points, forces = trace.contact_points[rows], trace.contact_forces[rows]
        self.arrows.visible = bool(len(points))
        if len(points):
            sizes = np.linalg.norm(forces, axis=1, keepdims=True)
            lengths = np.clip(_LENGTH * sizes, _SHORTEST, _LONGEST)
            starts = points - lengths * forces / np.maximum(sizes, 1e-9)
            self.arrows.points = np.stack([starts, points], axis=1).astype(np.float32)
        if self.sensors is not None:
            # Unchanged values are not sent.
            places, _ = self._links.sensors(self._links.frames(trace.joints[sample]))
            if np.abs(places - self.sensors.batched_positions).max() > _STILL:
                self.sensors.batched_positions = places.astype(np.float32)
            colors = ramp(0.5 + 0.5 * np.round(trace.tactile[sample] / _FULL, 1))
            if (colors != self.sensors.batched_colors).any():
                self.sensors.batched_colors = colors
            self.sensors.visible = True

    def _text(self, trace: Trace, sample: int) -> str:
        tensions = ", ".join(f"{value:.1f}" for value in trace.tensions[sample])
        lines = [
            f"{trace.time[sample]:.2f} s after closing began",
            f"contacts: {np.count_nonzero(trace.contact_samples == sample)}, "
            f"sum of normal forces {trace.hand_force[sample]:.1f} N",
        ]
        if tensions:
            lines.append(f"tendons: {tensions} N")
        if self.with_contacts.value and self.sensors is not None:
            for link in dict.fromkeys(self._links.sensor_links.tolist()):
                row = trace.tactile[sample, self._links.sensor_links == link]
                if row.any():
                    lines.append(f"tactile {self._links.names[link]}: " + " ".join(f"{v:.1f}" for v in row) + " N")
        return "  \n".join(lines)

    def toggle(self) -> None:
        """Play from the present sample, or from the beginning at the end; stop if it plays."""
        if self._plays.is_set():
            self.stop()
        elif self.trace is not None:
            if self.slider.value >= len(self.trace.time) - 1:
                self.seek(0)
            self._plays.set()
            self.play.label = "stop"
            self._canvas.thread(self._run, "player")

    def stop(self) -> None:
        """Stop playing."""
        self._plays.clear()

    def _run(self) -> None:
        trace, first = self.trace, int(self.slider.value)
        began = time.monotonic()
        while self._plays.is_set() and not self._canvas.closed.is_set() and trace is self.trace and trace is not None:
            passed = (time.monotonic() - began) * float(self.speed.value)
            sample = min(first + int(passed / 0.01), len(trace.time) - 1)
            last = sample == len(trace.time) - 1
            with self._canvas.lock:
                if time.monotonic() - self._read_at > _READING_PERIOD or last:
                    self.seek(sample)
                else:
                    self._draw(trace, sample)
            if last:
                break
            self._canvas.closed.wait(1.0 / _RATE)
        self._plays.clear()
        self.play.label = "play"
