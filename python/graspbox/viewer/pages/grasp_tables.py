"""The table that ``graspbox grasp --out`` writes: counts per object; each opens with its poses and outcomes."""

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from graspbox._common.files import read_bounded
from graspbox.errors import PlanError
from graspbox.outcomes import Outcomes
from graspbox.planning import Plan, decompose
from graspbox.planning.plan_files import mesh_hash
from graspbox.viewer.page import Page
from graspbox.viewer.pages.objects import PlannedObject
from graspbox.viewer.tables import html_table
from graspbox.viewer.wanted import find_object

__all__ = ["GraspTablePage", "read_table"]

_MAX_BYTES = 256 << 20


def read_table(path: Path) -> dict[str, Any] | None:
    """Read a table with grasps; None if the file is another JSON document.

    Raises
    ------
    FileError
        If the file cannot be read, or is larger than 256 MiB.
    """
    try:
        found = json.loads(read_bounded(path, _MAX_BYTES))
    except (ValueError, RecursionError):
        return None
    rows = found.get("objects") if isinstance(found, dict) else None
    fits = isinstance(rows, list) and rows and all(isinstance(row, dict) and "grasps" in row for row in rows)
    return found if fits else None


class GraspTablePage(Page):
    """Page of a table of grasps; `content` is the table."""

    title: ClassVar[str] = "grasps"

    def build(self) -> None:
        """Show the counts."""
        rows = self.content["objects"]
        columns = ("name", "tried", "succeeded", "secure")
        self.canvas.say(
            f"{self.content['succeeded']} of {self.content['tried']} poses succeed, {len(rows)} objects; choose one"
        )
        gui = self.canvas.gui
        self.table = gui.add_html(html_table(columns, [[row.get(name) for name in columns] for row in rows]))
        tried = tuple(row["name"] for row in rows if row["grasps"])
        if tried:
            self.choice = gui.add_dropdown("object", tried)
            self.canvas.on(gui.add_button("show its grasps"), call=lambda: self.open(str(self.choice.value)))

    def open(self, name: str) -> None:
        """Show the grasps of an object."""
        self.canvas.open(self.planned(name))

    def planned(self, name: str) -> PlannedObject:
        """Return an object of the table with its plan and outcomes; its boxes are computed again.

        Raises
        ------
        PlanError
            If the table is damaged.
        ObjectSetError
            If the object cannot be found.
        """
        row = next(one for one in self.content["objects"] if one["name"] == name)
        mesh = find_object(name, "", self.options)
        tree = decompose(mesh, max_boxes=8)
        grasps = row["grasps"]
        try:
            columns = {
                key: np.array([grasp[key] for grasp in grasps]) for key in ("preshape", "feasible", "score", "face")
            }
            box = np.minimum([int(grasp["box"]) for grasp in grasps], len(tree))
            # Older tables lack these columns; the objects of a table have no neighbours.
            columns |= {key: np.array([grasp.get(key, 0.0) for grasp in grasps]) for key in ("touch", "press")}
            poses = np.array([grasp["object_from_hand"] for grasp in grasps], dtype=np.float64)
            rest = np.array(row["world_from_object"], dtype=np.float64)
            outcomes = {key: [grasp[key] for grasp in grasps] for key in Outcomes.__dataclass_fields__}
        except (KeyError, TypeError, ValueError) as error:
            raise PlanError(f"the grasps of {name!r} are damaged: {error}") from None
        plan = Plan(poses, box=box, tree=tree, world_from_object=rest, name=name, mesh_sha256=mesh_hash(mesh),
                    hand_name=row["hand"], **columns)  # fmt: skip
        arrays = {key: np.array([np.nan if v is None else v for v in values]) for key, values in outcomes.items()}
        return PlannedObject(mesh, plan, Outcomes(**arrays))
