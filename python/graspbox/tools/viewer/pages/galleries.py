"""An object set as a gallery: a grid of its objects with their names, in sheets."""

from typing import Any, ClassVar

import numpy as np

from graspbox._common.refusals import is_refusal, reason
from graspbox.errors import ConfigError, GraspboxError
from graspbox.meshes import Mesh
from graspbox.object_sets import ObjectSet, ObjectSpec
from graspbox.tools.viewer.geometry import OBJECT, Color
from graspbox.tools.viewer.page import Page

#: Objects shown at a time.
_SHOWN = 60
#: Space between objects, as a share of the largest.
_GAP = 1.35
_CHOSEN: Color = (230, 159, 0)


class GalleryPage(Page):
    """Page of an object set; `content` is an `ObjectSet`."""

    title: ClassVar[str] = "object set"

    def build(self) -> None:
        """Make the controls; objects appear in the background, one by one."""
        objects: ObjectSet = self.content
        gui, pages = self.canvas.gui, -(-len(objects) // _SHOWN)
        self.nodes: dict[str, Any] = {}
        self.refused: dict[str, str] = {}
        self._parts: list[Any] = []
        self.chosen: ObjectSpec | None = None
        with gui.add_folder("Objects"):
            self.sheet = gui.add_slider("sheet", 1, max(pages, 2), 1, 1, disabled=pages == 1)
            self.named = gui.add_checkbox("names", True)
            self.choice = gui.add_dropdown("object", objects.names[:_SHOWN])
            self.reading = gui.add_markdown("click an object")
            self.open = gui.add_button("plan grasps of it", disabled=True)
        self.canvas.on(self.sheet, self.named, call=self.refresh)
        self.canvas.on(self.choice, call=lambda: self.choose(str(self.choice.value)))
        self.canvas.on(self.open, call=self._plan)
        self.refresh()

    def refresh(self) -> None:
        """Draw the sheet of the panel in the background."""
        number = min(int(self.sheet.value), -(-len(self.content) // _SHOWN))
        self.canvas.background(lambda: self._draw(number))

    def _draw(self, number: int) -> None:
        shown = self.content[(number - 1) * _SHOWN : number * _SHOWN]
        with self.canvas.lock:
            for node in self._parts:
                node.remove()
            self._parts, self.nodes = [], {}
            self.choice.options = shown.names
        meshes = [self._load(spec) for spec in shown]
        sizes = [float(np.max(np.ptp(mesh.bounds, axis=0)[:2])) for mesh in meshes if mesh is not None]
        if not sizes:
            return
        side, columns = _GAP * max(sizes), int(np.ceil(np.sqrt(len(shown))))
        rows = -(-len(shown) // columns)
        middle = side * np.array([columns - 1, -(rows - 1), 0]) / 2
        self.canvas.look(middle, 0.95 * side * max(columns, rows) + 0.2, (0.0, -1.0, 0.9))
        for index, (spec, mesh) in enumerate(zip(shown, meshes, strict=True)):
            if self.canvas.closed.is_set():
                return
            place = side * np.array([index % columns, -(index // columns), 0.0])
            if mesh is not None:
                self._draw_one(spec, mesh, place)
        left_out = "".join(f"  \n{name}: {why}" for name, why in self.refused.items())
        first = (number - 1) * _SHOWN + 1
        self.canvas.say(
            f"**{self.content.name}**: {len(self.content)} objects; {first} to {first + len(shown) - 1} shown{left_out}"
        )

    def _load(self, spec: ObjectSpec) -> Mesh | None:
        """Load an object; one that cannot be read is named in the panel."""
        try:
            return spec.load()
        except GraspboxError as error:
            if not is_refusal(error):
                raise
            self.refused[spec.name] = reason(error, spec.path)
            return None

    def _draw_one(self, spec: ObjectSpec, mesh: Mesh, place: Any) -> None:
        low, high = mesh.bounds
        pose = np.eye(4)
        pose[:3, 3] = place - [*(low + high)[:2] / 2, low[2]]
        with self.canvas.lock:
            node = self.canvas.mesh(f"/objects/{spec.name}", mesh, pose)
            node.on_click(self.canvas.under_lock(lambda: self.choose(spec.name)))
            self.nodes[spec.name] = node
            self._parts.append(node)
            if self.named.value:
                at = (*place[:2] - [0.0, 0.55 * float(high[1] - low[1])], 0.0)
                label = self.canvas.scene.add_label(
                    f"/names/{spec.name}", spec.name, position=at, anchor="top-center", font_screen_scale=0.8
                )
                self._parts.append(label)

    def choose(self, name: str) -> None:
        """Mark an object, and show its description."""
        if name not in self.content.names:
            raise ConfigError(f"there is no object {name!r} in {self.content.name!r}")
        self.chosen = self.content[self.content.names.index(name)]
        mesh = self.chosen.load()
        for other, node in self.nodes.items():
            node.color = _CHOSEN if other == name else OBJECT
        size = " x ".join(f"{1000 * x:.0f}" for x in np.ptp(mesh.bounds, axis=0))
        self.reading.content = (
            f"**{name}**: {size} mm, {mesh.mass:.3g} kg ({self.chosen.mass_known})  \n"
            f"{len(mesh.faces)} faces, {'watertight' if mesh.watertight else 'open'}, split {self.chosen.split}"
        )
        self.open.disabled = False

    def _plan(self) -> None:
        if self.chosen is not None:
            self.canvas.open(ObjectSet(self.chosen.name, (self.chosen,)))
