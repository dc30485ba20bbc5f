"""The objects of a scene and its walls: those beside the object of a page, or all of an environment."""

from typing import Any

import numpy as np

from graspbox.layouts import Arrangement
from graspbox.planning import Box
from graspbox.simulation import Scene
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.geometry import FREE, OBJECT, Color, Floats

__all__ = ["DrawnArrangement", "DrawnSurroundings"]

#: Colour of the other objects.
_OTHER: Color = (143, 179, 217)


def _draw_walls(canvas: Canvas, poses: Floats, half_extents: Floats) -> Any:
    """Draw the edges of walls (w, 4, 4), (w, 3) in one node; None without walls."""
    walls = zip(poses, half_extents, strict=True)
    corners = [Box(pose[:3, 3], pose[:3, :3], half).corners() for pose, half in walls]
    return canvas.boxes("/walls", np.stack(corners), [FREE] * len(corners)) if corners else None


class DrawnSurroundings:
    """Everything in a scene beside its object, at rest.

    Parameters
    ----------
    canvas : Canvas
        The canvas of the page.
    scene : Scene
        The scene.

    Attributes
    ----------
    others : list of scene nodes
        The other objects, in the order of `graspbox.Scene.others`.
    """

    def __init__(self, canvas: Canvas, scene: Scene) -> None:
        self._canvas, self._scene = canvas, scene
        self.others: list[Any] = [
            canvas.mesh(f"/others/{index}", mesh, pose, color=_OTHER)
            for index, (mesh, pose) in enumerate(zip(scene.others, scene.world_from_others, strict=True))
        ]
        self._walls = _draw_walls(canvas, scene.world_from_walls, scene.wall_half_extents)

    def rest(self) -> None:
        """Move the objects back to where they are at rest."""
        for node, pose in zip(self.others, self._scene.world_from_others, strict=True):
            self._canvas.move(node, pose)

    def remove(self) -> None:
        """Remove all nodes."""
        for node in (*self.others, self._walls):
            if node is not None:
                node.remove()


class DrawnArrangement:
    """All objects of an environment, and its walls; a target has another colour than the objects around it.

    Parameters
    ----------
    canvas : Canvas
        The canvas of the page.

    Attributes
    ----------
    nodes : list of scene nodes
        The objects that are there, in the order of the arrangement.
    """

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self.nodes: list[Any] = []
        self._walls: Any = None
        self._shown: tuple[Any, ...] = ()

    def show(self, arrangement: Arrangement) -> None:
        """Move the objects to where they lie; draw them anew where some are gone or others have come."""
        rows = zip(arrangement.objects, arrangement.meshes, strict=True)
        # The same object may be there twice, with different scales.
        shown = (arrangement.target, *((index, mesh.mass) for index, mesh in rows))
        if shown != self._shown:
            self._draw(arrangement)
            self._shown = shown
            return
        for node, pose in zip(self.nodes, arrangement.world_from_objects, strict=True):
            self._canvas.move(node, pose)

    def _draw(self, arrangement: Arrangement) -> None:
        for node in (*self.nodes, self._walls):
            if node is not None:
                node.remove()
        objects = zip(arrangement.meshes, arrangement.world_from_objects, strict=True)
        self.nodes = [
            self._canvas.mesh(
                f"/objects/{index}", mesh, pose, color=OBJECT if arrangement.target in (None, index) else _OTHER
            )
            for index, (mesh, pose) in enumerate(objects)
        ]
        self._walls = _draw_walls(self._canvas, arrangement.world_from_walls, arrangement.wall_half_extents)
