"""`Player`: the trace of a trial on a time slider, with the hand's joints, contacts and tactile values."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from graspbox.simulation.outcomes import Trace
from graspbox.tools.hand_links import HandLinks
from graspbox.tools.viewer.canvas import Canvas
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import FAILURE, ramp
from graspbox.tools.viewer.playback import Playback

#: Seconds between samples of a trace.
_PERIOD = 0.01
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
        self._read_at = 0.0
        gui = canvas.gui
        with gui.add_folder("Time"):
            self.playback = Playback(canvas, self._show, _PERIOD)
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
        canvas.on(self.with_contacts, call=lambda: self.playback.seek(int(self.playback.slider.value)))

    def load(self, trace: Trace) -> None:
        """Load a trace, and show its first sample; an empty one shows nothing."""
        self.clear()
        if not len(trace.time):
            return
        with self._canvas.lock:
            self.trace = trace
            self.playback.load(len(trace.time))

    def clear(self) -> None:
        """Forget the trace, and hide its contacts."""
        self.playback.load(0)
        with self._canvas.lock:
            self.trace = None
            self._hide()

    def _hide(self) -> None:
        self.readings.content = ""
        for node in (self.arrows, self.sensors):
            if node is not None:
                node.visible = False

    def _show(self, sample: int) -> None:
        if self.trace is not None:
            self._draw(self.trace, sample)

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
        if not self.playback.plays or now - self._read_at > _READING_PERIOD:
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
