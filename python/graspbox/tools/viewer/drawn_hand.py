"""A hand in the scene, with moving joints."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspbox.hands import Hand
from graspbox.meshes.shapes import Floats, boxes, cylinder
from graspbox.tools.hand_links import link_boxes, moving_frames
from graspbox.tools.viewer.canvas import Canvas
from graspbox.tools.viewer.geometry import Color

_PAD: Color = (92, 100, 112)
_BARE: Color = (176, 184, 196)
_HINGE: Color = (77, 82, 92)
#: Radius and half length of a hinge, as shares of the middle and the least half side of its link, and its facets.
_RADIUS, _LENGTH, _FACETS = 1.1, 1.5, 12
#: A link whose frame changed by less is not sent again, metres and shares of 1.
_STILL = 1e-5


class DrawnHand:
    """A hand, drawn by its collision shapes and hinges, with nodes ``name/row`` for the links of `moving_frames`."""

    def __init__(self, canvas: Canvas, name: str, hand: Hand, opacity: float | None = None) -> None:
        self.hand, self._canvas, self.name = hand, canvas, name
        self.world_from_hand: Floats = np.eye(4)
        self.joints: Floats = hand.open(hand.preshape_limits[0])
        self.root = canvas.frame(name, self.world_from_hand)
        self.links: dict[int, Any] = {}
        self._sent = moving_frames(hand, self.joints)
        for row, link in enumerate(link_boxes(hand)):
            path = f"{name}/{row}"
            if len(link.frames) and row:
                self.links[row] = canvas.frame(path, self._sent[row])
            for part, chosen, color in (("shapes", ~link.pads, _BARE), ("pads", link.pads, _PAD)):
                if chosen.any():
                    shape = boxes(link.frames[chosen], link.half_extents[chosen])
                    canvas.mesh(f"{path}/{part}", shape, color=color, opacity=opacity)
            if len(link.frames) and link.revolute:
                largest = int(link.half_extents.prod(axis=1).argmax())
                least, middle, _ = np.sort(link.half_extents[largest])
                center = (link.frames[largest, 0, 3], 0.0, 0.0)
                hinge = cylinder(center, (1.0, 0.0, 0.0), _RADIUS * middle, _LENGTH * least, _FACETS)
                canvas.mesh(f"{path}/hinge", hinge, color=_HINGE, opacity=opacity)

    def pose(self, world_from_hand: Floats, joints: ArrayLike) -> None:
        """Move the grasp frame to a pose (4, 4), and the independent joints to positions (c,), rad or m."""
        self.world_from_hand, self.joints = world_from_hand, np.ascontiguousarray(joints, dtype=np.float64)
        self._canvas.move(self.root, world_from_hand)
        frames = moving_frames(self.hand, self.joints)
        for row, node in self.links.items():
            if np.abs(frames[row] - self._sent[row]).max() > _STILL:
                self._canvas.move(node, frames[row])
                self._sent[row] = frames[row]

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return bool(self.root.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        self.root.visible = shown

    def remove(self) -> None:
        """Remove it from the scene."""
        self.root.remove()
