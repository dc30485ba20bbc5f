"""A hand: sliders for joints and preshape, collision shapes, tendons, sensors, swept volume; its files are watched."""

from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from graspbox.errors import GraspboxError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.meshes.shapes import Floats
from graspbox.perception.hand_grids import HandGrid
from graspbox.tools.hand_links import HandLinks
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import COLORS, ramp
from graspbox.tools.viewer.page import Page

#: Seconds between checks of the files.
_PERIOD = 0.5
#: Radius of a sensor in the scene, and length of its normal, metres.
_SENSOR, _NORMAL = 0.0022, 0.008
_OPACITY = 0.55


class HandPage(Page):
    """Page of a hand; `content` is the hand, its name, or its two files, which are read again when they change."""

    title: ClassVar[str] = "hand"

    def build(self) -> None:
        """Draw the hand; invalid files show an empty page with the error until they are corrected."""
        source: HandLike = self.content
        self._files = [Path(path) for path in source] if isinstance(source, tuple) else []
        self._text = self._contents()
        self.hand: Hand | None = None
        self._parts: list[Any] = []
        self._folder: Any = None
        self.read()
        if self._files:
            self.canvas.thread(self._watch, "files")
        elif self.hand is None:
            load_hand(source)  # raises

    def _contents(self) -> list[bytes]:
        """Return the contents of the files; of a file that cannot be read, nothing."""
        contents = []
        for path in self._files:
            with suppress(OSError):
                contents.append(path.read_bytes())
        return contents

    def _watch(self) -> None:
        while not self.canvas.closed.wait(_PERIOD):
            self.check()

    def check(self) -> bool:
        """Read the files again if they have changed; return whether they have."""
        text = self._contents()
        if text == self._text:
            return False
        self._text = text
        self.read()
        return True

    def read(self) -> None:
        """Read the hand and draw it; after an error the last valid hand is kept."""
        try:
            hand = load_hand(self.content)
            links = HandLinks(hand)
        except GraspboxError as error:
            lines = str(error).splitlines()
            self.canvas.complain("  \n".join(lines) + ("  \nThe last valid version is kept." if self.hand else ""))
            return
        with self.canvas.lock, self.canvas.server.atomic():
            before = {} if self.hand is None else {name: float(one.value) for name, one in self.sliders.items()}
            self._remove()
            self.hand, self.links = hand, links
            self.drawn = DrawnHand(self.canvas, "/hand", hand, _OPACITY)
            self._swept: dict[int, Any] = {}
            self._grid: HandGrid | None = None
            self._controls(before)
            self._draw_parts()
            self.refresh()
            self.canvas.complain("")
        if not before:
            self.canvas.look((0.0, 0.0, 0.03), 0.34, (1.0, -0.9, 0.5))

    def _remove(self) -> None:
        if self.hand is not None:
            self.drawn.remove()
            self._folder.remove()
        for node in self._parts:
            node.remove()
        self._parts = []

    def _controls(self, before: dict[str, float]) -> None:
        """Make the sliders; those whose joint is still there keep their values."""
        assert self.hand is not None
        hand, gui = self.hand, self.canvas.gui
        low, high = hand.preshape_limits
        self._folder = gui.add_folder("Hand")
        with self._folder:
            with gui.add_folder("Show"):
                self.show_tendons = gui.add_checkbox("tendons", True, disabled=not hand.tendons)
                self.show_sensors = gui.add_checkbox("sensors", True, disabled=not len(self.links.sensor_links))
                self.show_swept = gui.add_checkbox("swept volume", False, hint="cells that the fingers sweep")
            with gui.add_folder("Grasp"):
                step = 1.0 if hand.preshape_unit == "1" else max(round((high - low) / 200, 5), 1e-5)
                self.preshape = gui.add_slider("preshape", low, max(high, low + step), step, low, disabled=low == high)
                self.closed = gui.add_slider("closed", 0.0, 1.0, 0.01, 0.0, hint="share of the way that it closes")
            self.sliders: dict[str, Any] = {}
            positions = hand.open(low)
            with gui.add_folder("Joints"):
                for name, (least, most), at in zip(hand.joints, hand.joint_limits, positions, strict=True):
                    step = max(round(float(most - least) / 200, 6), 1e-6)
                    initial = float(np.clip(before.get(name, at), least, most))
                    self.sliders[name] = gui.add_slider(name, float(least), float(most), step, initial)
        self.canvas.on(self.preshape, self.closed, call=self._grasp)
        self.canvas.on(*self.sliders.values(), call=self.refresh)
        self.canvas.on(self.show_tendons, self.show_sensors, self.show_swept, call=self.refresh)

    def _grasp(self) -> None:
        """Move the joints to the preshape, closed by a share."""
        assert self.hand is not None
        positions = self.hand.closed(float(self.preshape.value), float(self.closed.value))
        self._setting = True
        try:
            for slider, value in zip(self.sliders.values(), positions, strict=True):
                slider.value = float(value)
        finally:
            self._setting = False
        self.refresh()

    _setting = False

    @property
    def joints(self) -> Floats:
        """Positions of the sliders, (c,), rad or m."""
        return np.array([slider.value for slider in self.sliders.values()], dtype=np.float64)

    def _draw_parts(self) -> None:
        """Make the nodes of tendons and sensors; `refresh` moves them."""
        canvas, count = self.canvas, len(self.links.sensor_links)
        self.tendons = [
            canvas.lines(f"/tendons/{index}", np.zeros((1, 2, 3)), COLORS[index % len(COLORS)], 3.0)
            for index in range(len(self.links.tendons))
        ]
        self.sensors = self.normals = None
        self._parts = list(self.tendons)
        if count:
            self.sensors = canvas.spheres("/sensors", _SENSOR, np.zeros((count, 3)), COLORS[3])
            self.normals = canvas.lines("/normals", np.zeros((count, 2, 3)), COLORS[3], 1.5)
            self._parts += [self.sensors, self.normals]

    def refresh(self) -> None:
        """Draw the hand at the positions of the sliders."""
        if self._setting:
            return
        assert self.hand is not None
        hand, joints = self.hand, self.joints
        with self.canvas.server.atomic():
            self.drawn.pose(np.eye(4), joints)
            frames = self.links.frames(joints)
            for tendon, node in zip(self.links.tendons, self.tendons, strict=True):
                node.points = self.links.route(tendon, frames).astype(np.float32)
                node.visible = bool(self.show_tendons.value)
            if self.sensors is not None and self.normals is not None:
                points, normals = self.links.sensors(frames)
                self.sensors.batched_positions = points.astype(np.float32)
                self.normals.points = np.stack([points, points + _NORMAL * normals], axis=1).astype(np.float32)
                self.sensors.visible = self.normals.visible = bool(self.show_sensors.value)
            self._show_swept()
        counts = f"{len(hand.joints)} joints, {len(hand.actuators)} actuators, {len(hand.tendons)} tendons"
        named = ", ".join(f"{name} {value:.3g}" for name, value in hand.preshapes.items())
        self.canvas.say(
            f"**{hand.name}**  \n{counts}, {len(self.links.sensor_links)} sensors  \npreshapes: {named}  \n"
            "tendons are drawn by their moment arms: the files have no routes"
        )

    def _show_swept(self) -> None:
        """Show the cells that the fingers sweep with the nearest preshape; blue at once, orange at the end."""
        for node in self._swept.values():
            node.visible = False
        if not self.show_swept.value:
            return
        if self._grid is None:
            self._grid = HandGrid(self.hand)  # type: ignore[arg-type]
        grid = self._grid
        index = int(grid.nearest([float(self.preshape.value)])[0])
        if index not in self._swept:
            cells = np.argwhere(grid.swept[index] > 0)
            when = grid.swept[index][tuple(cells.T)].astype(np.float64)
            self._swept[index] = self.canvas.scene.add_point_cloud(
                f"/swept/{index}",
                (grid.origin + (cells + 0.5) * grid.cell).astype(np.float32),
                ramp((255.0 - when) / (255.0 - 64.0)),
                point_size=0.25 * grid.cell,
                point_shape="circle",
                precision="float32",
            )
            self._parts.append(self._swept[index])
        self._swept[index].visible = True
