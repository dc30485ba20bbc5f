"""Objects and walls in a view: those around the object of a page, or all of an environment."""

from typing import Any

from graspbox.meshes import Surroundings
from graspbox.simulation.layouts import Arrangement
from graspbox.tools.viewer.canvas import Canvas
from graspbox.tools.viewer.geometry import OBJECT, OTHER


class DrawnObjects:
    """Objects at rest or moving, in nodes ``name/index``, and walls; a target has its own colour.

    Attributes
    ----------
    nodes : list of scene nodes
        The objects, in the order of their surroundings.
    """

    def __init__(self, canvas: Canvas, name: str) -> None:
        self._canvas, self._name = canvas, name
        self.nodes: list[Any] = []
        self._walls: Any = None
        self._shown: tuple[Any, ...] | None = None

    def show(self, around: Surroundings) -> None:
        """Move the objects to their poses; redraw them when objects were removed or added."""
        target = around.target if isinstance(around, Arrangement) else -1
        indices = around.objects if isinstance(around, Arrangement) else range(len(around.meshes))
        # An object may occur twice, with different scales.
        shown = (target, *((index, mesh.mass) for index, mesh in zip(indices, around.meshes, strict=True)))
        if shown == self._shown:
            for node, pose in zip(self.nodes, around.world_from_objects, strict=True):
                self._canvas.move(node, pose)
            return
        for node in (*self.nodes, self._walls):
            if node is not None:
                node.remove()
        objects = zip(around.meshes, around.world_from_objects, strict=True)
        self.nodes = [
            self._canvas.mesh(f"{self._name}/{i}", mesh, pose, color=OBJECT if target in (None, i) else OTHER)
            for i, (mesh, pose) in enumerate(objects)
        ]
        self._walls, self._shown = self._canvas.walls(around), shown
