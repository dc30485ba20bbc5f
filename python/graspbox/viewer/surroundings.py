"""The other objects of a scene, and its walls."""

from typing import Any

import numpy as np

from graspbox.planning import Box
from graspbox.simulation import Scene
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.geometry import FREE, Color

__all__ = ["DrawnSurroundings"]

#: Colour of the other objects.
_OTHER: Color = (143, 179, 217)


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
        walls = zip(scene.world_from_walls, scene.wall_half_extents, strict=True)
        corners = [Box(pose[:3, 3], pose[:3, :3], half).corners() for pose, half in walls]
        self._walls = canvas.boxes("/walls", np.stack(corners), [FREE] * len(corners)) if corners else None

    def rest(self) -> None:
        """Move the objects back to where they are at rest."""
        for node, pose in zip(self.others, self._scene.world_from_others, strict=True):
            self._canvas.move(node, pose)

    def remove(self) -> None:
        """Remove all nodes."""
        for node in (*self.others, self._walls):
            if node is not None:
                node.remove()
