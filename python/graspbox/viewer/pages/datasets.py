"""A data set: its rows in a table with filters, the images of a row, and its trial replayed."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from graspbox import dataset
from graspbox._common.arguments import config_of
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.dataset import manifest
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand
from graspbox.simulation import Scene
from graspbox.viewer.drawn_hand import DrawnHand
from graspbox.viewer.geometry import depth_picture
from graspbox.viewer.page import Page
from graspbox.viewer.player import Player
from graspbox.viewer.surroundings import DrawnSurroundings
from graspbox.viewer.tables import html_table

__all__ = ["DatasetPage"]

_ALL = "all"
#: Rows of a sheet of the table, images of a row, and their side in pixels.
_SHEET, _VIEWS, _SIDE = 15, 4, 128
_COLUMNS = ("object", "split", "candidate", "failure", "secure", "lift")
#: Most choices in a filter.
_CHOICES = 500


class DatasetPage(Page):
    """Page of a data set; `content` is its folder."""

    title: ClassVar[str] = "data set"

    def build(self) -> None:
        """Read the rows and show the first."""
        folder: Path = self.content
        self.table = dataset.load(folder)
        self._config: dict[str, Any] = (manifest.read(folder) or {})["config"]
        self.columns = {
            name: dataset.column(self.table, name)
            for name in ("object", "split", "candidate", "failure", "success", "secure", "lift")
        }
        gui = self.canvas.gui
        outcomes = (_ALL, "success", "secure", *np.unique(self.columns["failure"]).tolist())
        with gui.add_folder("Rows"):
            self.split = gui.add_dropdown("split", (_ALL, *np.unique(self.columns["split"]).tolist()))
            self.object = gui.add_dropdown("object", (_ALL, *np.unique(self.columns["object"]).tolist()[:_CHOICES]))
            self.candidate = gui.add_dropdown("candidate", (_ALL, *np.unique(self.columns["candidate"]).tolist()))
            self.outcome = gui.add_dropdown("outcome", tuple(dict.fromkeys(one for one in outcomes if one)))
            self.sheet = gui.add_number("sheet", 1, min=1, step=1)
            self.rows = gui.add_html("")
            self.number = gui.add_number("row", 0, min=0, max=max(len(self.table) - 1, 0), step=1)
            self.replay = gui.add_button("replay this row")
            self.verdict = gui.add_markdown("")
        with gui.add_folder("Images"):
            blank = np.full((_SIDE, _SIDE, 3), 255, dtype=np.uint8)
            self.images = [gui.add_image(blank, visible=False) for _ in range(2 * _VIEWS)]
        self.canvas.on(self.split, self.object, self.candidate, self.outcome, self.sheet, call=self.refresh)
        self.canvas.on(self.number, self.replay, call=lambda: self.select(int(self.number.value)))
        self.canvas.table()
        self.player: Player | None = None
        self._hand: DrawnHand | None = None
        self._folders: list[Any] = []
        self._around: DrawnSurroundings | None = None
        self.refresh()
        self.select(int(self.kept()[0]) if len(self.kept()) else 0)

    def kept(self) -> NDArray[np.int64]:
        """Return the indices of the rows that the filters keep."""
        found = np.ones(len(self.table), dtype=np.bool_)
        for control, name in ((self.split, "split"), (self.object, "object"), (self.candidate, "candidate")):
            if control.value != _ALL:
                found &= self.columns[name] == control.value
        outcome = self.outcome.value
        if outcome in ("success", "secure"):
            found &= self.columns[outcome]
        elif outcome != _ALL:
            found &= self.columns["failure"] == outcome
        return np.flatnonzero(found)

    def refresh(self) -> None:
        """Show the sheet of the table that the filters and the panel choose."""
        kept = self.kept()
        sheets = max(-(-len(kept) // _SHEET), 1)
        sheet = min(int(self.sheet.value), sheets)
        shown = kept[(sheet - 1) * _SHEET : sheet * _SHEET]
        rows = [[int(i), *(self.columns[name][i].item() for name in _COLUMNS)] for i in shown]
        for row in rows:
            row[4] = row[4] or "success"
        marked = np.flatnonzero(shown == int(self.number.value))
        self.rows.content = html_table(("row", *_COLUMNS), rows, int(marked[0]) if len(marked) else None)
        rate = float(self.columns["success"][kept].mean()) if len(kept) else 0.0
        self.canvas.say(
            f"**{self.content}**  \n{len(kept)} of {len(self.table)} rows, {rate:.1%} succeed; "
            f"sheet {sheet} of {sheets}"
        )

    def select(self, index: int) -> None:
        """Show a row: its images, and its trial as it is simulated again."""
        if not 0 <= index < len(self.table):
            raise ConfigError(f"the row {index} does not exist; choose from 0 to {len(self.table) - 1}")
        self.number.value = index
        row = self.table.slice(index, 1)
        values = {name: row[name].to_pylist()[0] for name in row.column_names if name != "world_from_camera"}
        self._show_images(row)
        hand = load_hand(values["hand"] if values["hand"] in Hand.names() else self.options.hand)
        physics = config_of(PhysicsConfig, self._config.get("physics") or {}, "physics")
        scene = dataset.scene_of(row, hand=hand, physics=physics)
        trial = config_of(TrialConfig, self._config.get("trial") or {}, "trial")
        pose = np.array(values["executed_object_from_hand"]).reshape(4, 4)
        factors = {name: values[f"{name}_factor"] for name in ("friction", "mass")}
        outcomes, trace = scene.trace(pose, values["preshape"], **factors, config=trial)
        self._show_scene(scene, hand)
        assert self.player is not None
        assert self._hand is not None
        self._hand.pose(scene.world_from_object @ pose, hand.open(values["preshape"]))
        self.player.load(trace)
        again = outcomes.failure[0] or "success"
        self.verdict.content = (
            f"row {index}: **{values['failure'] or 'success'}**, replayed: {again}  \n"
            f"candidate {values['candidate']}, preshape {values['preshape']:.2f}, friction {values['friction']:.2f}, "
            f"mass {values['mass']:.3g} kg"
        )
        self.refresh()

    def _show_images(self, row: Any) -> None:
        """Render the views of a row: colours and depth of each camera."""
        found = dataset.render(row, image_size=_SIDE, rgb=True, segmentation=False)
        assert found.rgb is not None
        shown = [image for view in range(min(found.depth.shape[1], _VIEWS))
                 for image in (found.rgb[0, view], depth_picture(found.depth[0, view]))]  # fmt: skip
        for node, image in zip(self.images, shown, strict=False):
            node.image, node.visible = image, True

    def _show_scene(self, scene: Scene, hand: Hand) -> None:
        """Draw objects, walls, hand and player anew."""
        with self.canvas.server.atomic():
            if self._around is not None:
                self._around.remove()
            self._around = DrawnSurroundings(self.canvas, scene)
            self.node = self.canvas.frame("/object", scene.world_from_object)
            self.canvas.mesh("/object/mesh", scene.mesh)
            if self.player is None:
                size = float(np.linalg.norm(np.ptp(scene.mesh.bounds, axis=0)))
                self.canvas.look(scene.world_from_object[:3, 3], max(2.5 * size, 0.5))
            else:
                self.player.remove()
            if self._hand is not None:
                self._hand.remove()
            self._hand = DrawnHand(self.canvas, "/hand", hand)
            self.player = Player(self.canvas, self._hand, self.node, self._around.others)

    def close(self) -> None:
        """Stop the player."""
        if getattr(self, "player", None) is not None:
            self.player.stop()  # type: ignore[union-attr]
