"""`Player`: the trace of a trial on a time slider, with the hand's joints, contacts and tactile values."""

import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from graspbox.hands import Hand
from graspbox.outcomes import Trace
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.drawn_hand import DrawnHand
from graspbox.viewer.geometry import FAILURE, Floats, ramp, sphere
from graspbox.viewer.links import HandLinks

__all__ = ["Player"]

#: Frames per second while a trace plays.
_RATE = 30.0
#: Length of a force arrow, metres per N, and its bounds, metres.
_LENGTH, _SHORTEST, _LONGEST = 0.005, 0.01, 0.08
#: Seconds between changes of the readings while a trace plays, and a change of place that is not sent, metres.
_TOLD, _STILL = 0.2, 2e-4
#: Radius of a sensor in the scene, metres, and the force that has the last colour, N.
_SENSOR, _FULL = 0.0028, 5.0


class Player:
    """Plays traces of trials with one hand.

    Parameters
    ----------
    canvas : Canvas
        The canvas of the page.
    hand : DrawnHand
        The hand that moves.
    node : scene node
        The scene's object.
    others : sequence of scene nodes
        The scene's other objects, in the order of `graspbox.Scene.others`.
    """

    def __init__(self, canvas: Canvas, hand: DrawnHand, node: Any, others: Sequence[Any] = ()) -> None:
        self._canvas, self._hand, self._nodes = canvas, hand, (node, *others)
        self._links = HandLinks(hand.hand)
        self.trace: Trace | None = None
        self._plays, self._told = threading.Event(), 0.0
        gui = canvas.gui
        self._folder = gui.add_folder("Time")
        with self._folder:
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
        self.sensors = self._sensor_node(len(self._links.sensor_links))
        canvas.on(self.slider, self.with_contacts, call=self._moved)
        canvas.on(self.play, call=self.toggle)

    def _sensor_node(self, count: int) -> Any:
        if not count:
            return None
        return self._canvas.scene.add_batched_meshes_simple(
            f"{self._hand.name}/sensors",
            *sphere(_SENSOR),
            batched_wxyzs=np.tile(np.array([1.0, 0, 0, 0], dtype=np.float32), (count, 1)),
            batched_positions=np.zeros((count, 3), dtype=np.float32),
            batched_colors=np.full((count, 3), 150, dtype=np.uint8),
            lod="off",
            visible=False,
        )

    @property
    def hand(self) -> Hand:
        """The hand."""
        return self._hand.hand

    def load(self, trace: Trace) -> None:
        """Load a trace, and show its first sample; an empty one shows nothing."""
        self.stop()
        with self._canvas.lock:
            self.trace = trace if len(trace.time) else None
            self.play.disabled = self.slider.disabled = self.trace is None
            if self.trace is None:
                self._hide()
                return
            self.slider.max = max(len(trace.time) - 1, 1)
            self.seek(0)

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
            self._draw(min(int(self.slider.value), len(self.trace.time) - 1))

    def _draw(self, sample: int) -> None:
        assert self.trace is not None
        trace = self.trace
        with self._canvas.server.atomic():
            self._hand.pose(trace.world_from_hand[sample], trace.joints[sample])
            poses = (trace.world_from_object[sample], *trace.world_from_others[sample])
            for node, pose in zip(self._nodes, poses, strict=True):
                self._canvas.move(node, pose)
            self._draw_contacts(sample)

    def _draw_contacts(self, sample: int) -> None:
        assert self.trace is not None
        trace = self.trace
        if not self.with_contacts.value:
            self._hide()
            self._tell(sample, None)
            return
        rows = trace.contacts(sample)
        points, forces = trace.contact_points[rows], trace.contact_forces[rows]
        self.arrows.visible = bool(len(points))
        if len(points):
            sizes = np.linalg.norm(forces, axis=1, keepdims=True)
            lengths = np.clip(_LENGTH * sizes, _SHORTEST, _LONGEST)
            starts = points - lengths * forces / np.maximum(sizes, 1e-9)
            self.arrows.points = np.stack([starts, points], axis=1).astype(np.float32)
        values = None
        if self.sensors is not None:
            values = trace.tactile[sample]
            places, _ = self._links.sensors(self._links.frames(trace.joints[sample]))
            self._color_sensors(places, ramp(0.5 + 0.5 * np.round(values / _FULL, 1)))
        self._tell(sample, values)

    def _color_sensors(self, points: Floats, colors: Any) -> None:
        """Move the sensors in the hand's frame, and colour them; unchanged values are not sent."""
        if np.abs(points - self.sensors.batched_positions).max() > _STILL:
            self.sensors.batched_positions = points.astype(np.float32)
        if (colors != self.sensors.batched_colors).any():
            self.sensors.batched_colors = colors
        self.sensors.visible = True

    def _tell(self, sample: int, values: Floats | None) -> None:
        """Show the readings; while a trace plays, at a lower rate."""
        now = time.monotonic()
        if not self._plays.is_set() or now - self._told > _TOLD:
            self._told = now
            self.readings.content = self._text(sample, values)

    def _text(self, sample: int, values: Floats | None) -> str:
        assert self.trace is not None
        trace = self.trace
        tensions = ", ".join(f"{value:.1f}" for value in trace.tensions[sample])
        lines = [
            f"{trace.time[sample]:.2f} s after closing began",
            f"contacts: {np.count_nonzero(trace.contact_samples == sample)}, "
            f"sum of normal forces {trace.hand_force[sample]:.1f} N",
        ]
        if tensions:
            lines.append(f"tendons: {tensions} N")
        if values is not None:
            for link in dict.fromkeys(self._links.sensor_links.tolist()):
                row = values[self._links.sensor_links == link]
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

    def remove(self) -> None:
        """Remove its controls and nodes; those in the hand go with the hand."""
        self.stop()
        self.trace = None
        self._folder.remove()
        self.arrows.remove()

    def _run(self) -> None:
        trace, first = self.trace, int(self.slider.value)
        began = time.monotonic()
        while self._plays.is_set() and not self._canvas.closed.is_set() and trace is self.trace and trace is not None:
            passed = (time.monotonic() - began) * float(self.speed.value)
            sample = min(first + int(passed / 0.01), len(trace.time) - 1)
            last = sample == len(trace.time) - 1
            with self._canvas.lock:
                if time.monotonic() - self._told > _TOLD or last:
                    self.seek(sample)
                else:
                    self._draw(sample)
            if last:
                break
            self._canvas.closed.wait(1.0 / _RATE)
        self._plays.clear()
        self.play.label = "play"
