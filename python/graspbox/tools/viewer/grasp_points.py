"""Grasp poses as a cloud of points that a user can click: one node for any number of poses."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.meshes.shapes import Floats
from graspbox.tools.viewer.canvas import Canvas

#: Radius of a point, metres.
_RADIUS = 0.0025


class GraspPoints:
    """A cloud of points, one at the origin of the hand's frame (at its palm) in each grasp pose.

    Points where the hands close would lie inside the object. `poses` are ``world_from_hand`` (n, 4, 4); `on_click` is
    called with the index of the pose that a user clicks.
    """

    def __init__(self, canvas: Canvas, name: str, poses: Floats, on_click: Callable[[int], None]) -> None:
        self._canvas, self._name, self._on_click = canvas, name, on_click
        self._points = poses[:, :3, 3]
        #: The node that is shown, and the indices of its poses.
        self.node: Any = None
        self.rows: NDArray[np.int64] = np.zeros(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self._points)

    @property
    def shown(self) -> int:
        """Number of points in the scene."""
        return len(self.rows)

    def show(self, mask: NDArray[np.bool_], colors: NDArray[np.uint8]) -> None:
        """Show the points of a mask (n,) in colours (n, 3), instead of those shown before."""
        self.rows = np.flatnonzero(mask)
        if not len(self.rows):
            self.remove()
            return
        points, shadows = self._points[self.rows], {"cast_shadow": False, "receive_shadow": False}
        self.node = self._canvas.spheres(self._name, _RADIUS, points, colors[self.rows], **shadows)
        self.node.on_click(self._canvas.guarded(self._clicked))

    def _clicked(self, event: Any) -> None:
        index = event.instance_index
        if index is None:
            index = self._nearest(np.array(event.ray_origin), np.array(event.ray_direction))
        if 0 <= index < len(self.rows):
            with self._canvas.lock:
                self._on_click(int(self.rows[index]))

    def _nearest(self, origin: Floats, direction: Floats) -> int:
        """Return the row of the point nearest to a ray."""
        offsets = self._points[self.rows] - origin
        beside = offsets - (offsets @ direction)[:, None] * direction
        return int(np.linalg.norm(beside, axis=1).argmin())

    def remove(self) -> None:
        """Remove the node."""
        if self.node is not None:
            self.node.remove()
            self.node = None
        self.rows = np.zeros(0, dtype=np.int64)
