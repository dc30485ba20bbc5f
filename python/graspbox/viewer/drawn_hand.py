"""Hands in the scene: one with moving joints, and many grasp poses as small wire hands in few nodes."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.hands import Hand
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.geometry import Color, Floats, Solid, boxes, hinge, needles, split_all, sticks, wire_hand

__all__ = ["DrawnHand", "PoseSet"]

_PAD: Color = (92, 100, 112)
_BARE: Color = (176, 184, 196)
_HINGE: Color = (77, 82, 92)
#: Radius and half length of a hinge, as shares of the middle and the least half side of its link.
_RADIUS, _LENGTH = 1.1, 1.5
#: Radius of the sticks of a wire hand, metres.
_STICK = 0.0008
#: More poses than this are drawn with one triangle per line.
_MANY = 1000
#: A link whose frame changed by less is not sent again, metres and shares of 1.
_STILL = 1e-5
#: Most different shapes of wire hands in one set; other preshapes use the nearest.
_MOST_SHAPES = 6


class DrawnHand:
    """A hand, drawn by its collision shapes and hinges; with a node for each moving link.

    Parameters
    ----------
    canvas : Canvas
        The canvas of the page.
    name : str
        Name of its nodes.
    hand : Hand
        The hand.
    opacity : float, optional
        Between 0 and 1; by default opaque.
    """

    def __init__(self, canvas: Canvas, name: str, hand: Hand, opacity: float | None = None) -> None:
        self.hand, self._canvas, self.name = hand, canvas, name
        self.world_from_hand: Floats = np.eye(4)
        self.joints: Floats = hand.open(hand.preshape_limits[0])
        self.root = canvas.frame(name, self.world_from_hand)
        shapes, halves, pads, carriers = hand.shapes(self.joints)
        frames, _, revolute = hand.joint_frames(self.joints)
        #: Frames of the links that joints move, by row of `graspbox.Hand.joint_frames`.
        self.links = {
            int(row): canvas.frame(f"{name}/{row}", frames[row]) for row in np.unique(carriers[carriers >= 0])
        }
        self._sent = {row: frames[row] for row in self.links}
        for row in np.unique(carriers):
            link_from_hand = np.linalg.inv(frames[row]) if row >= 0 else np.eye(4)
            for pad in (False, True):
                found = np.flatnonzero((carriers == row) & (pads == pad))
                if len(found):
                    solid = boxes(link_from_hand @ shapes[found], halves[found])
                    self._node(int(row), "pads" if pad else "shapes", solid, _PAD if pad else _BARE, opacity)
            if row >= 0 and revolute[row]:
                link = int(np.where(carriers == row, halves.prod(axis=1), -1.0).argmax())
                least, middle, _ = np.sort(halves[link])
                along = float((link_from_hand @ shapes[link])[0, 3])
                self._node(int(row), "hinge", hinge(along, _LENGTH * least, _RADIUS * middle), _HINGE, opacity)

    def _node(self, row: int, part: str, solid: Solid, color: Color, opacity: float | None) -> None:
        name = f"{self.name}/{row}/{part}" if row >= 0 else f"{self.name}/{part}"
        self._canvas.scene.add_mesh_simple(name, *solid, color=color, opacity=opacity, flat_shading=True)

    def pose(self, world_from_hand: Floats, joints: ArrayLike) -> None:
        """Move the hand.

        Parameters
        ----------
        world_from_hand : (4, 4) float64
            Pose of the grasp frame, metres.
        joints : (c,) array_like
            Positions of the independent joints, rad or m.
        """
        self.world_from_hand, self.joints = world_from_hand, np.ascontiguousarray(joints, dtype=np.float64)
        self._canvas.move(self.root, world_from_hand)
        frames = self.hand.joint_frames(self.joints)[0]
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


class PoseSet:
    """Grasp poses as small wire hands: one node of instances for each shape of the hand, for any number of poses.

    Parameters
    ----------
    canvas, name, hand
        As of `DrawnHand`.
    poses : (n, 4, 4) float64
        ``world_from_hand``, metres.
    preshape : (n,) float64
        See `graspbox.Hand.preshape_limits`.
    picked : callable, optional
        Called with the index of a pose that a user clicks.
    """

    def __init__(
        self,
        canvas: Canvas,
        name: str,
        hand: Hand,
        poses: Floats,
        preshape: Floats,
        picked: Callable[[int], None] | None = None,
    ) -> None:
        self._canvas, self._name, self._picked = canvas, name, picked
        self._wxyz, self._positions = split_all(poses)
        shapes = np.unique(preshape)
        if len(shapes) > _MOST_SHAPES:
            shapes = np.linspace(shapes[0], shapes[-1], _MOST_SHAPES)
        self._shape = np.abs(preshape[:, None] - shapes).argmin(axis=1)
        wires = [wire_hand(hand, float(value)) for value in shapes]
        self._fine, self._coarse = ([lines(wire, _STICK) for wire in wires] for lines in (sticks, needles))
        #: Nodes that are shown, by shape, and the indices of the poses of each.
        self.nodes: dict[int, Any] = {}
        self.rows: dict[int, NDArray[np.int64]] = {}

    def __len__(self) -> int:
        return len(self._shape)

    @property
    def shown(self) -> int:
        """Number of poses in the scene."""
        return sum(len(node.batched_positions) for node in self.nodes.values())

    def show(self, mask: NDArray[np.bool_], colors: NDArray[np.uint8]) -> None:
        """Show the poses of a mask (n,) in colours (n, 3), instead of those shown before."""
        solids = self._coarse if int(mask.sum()) > _MANY else self._fine
        with self._canvas.server.atomic():
            for shape, solid in enumerate(solids):
                found = np.flatnonzero(mask & (self._shape == shape))
                self.rows[shape] = found
                if not len(found):
                    if (node := self.nodes.pop(shape, None)) is not None:
                        node.remove()
                    continue
                # A node with the name of another one replaces it, in one message.
                self.nodes[shape] = self._canvas.scene.add_batched_meshes_simple(
                    f"{self._name}/{shape}",
                    *solid,
                    batched_wxyzs=self._wxyz[found],
                    batched_positions=self._positions[found],
                    batched_colors=np.ascontiguousarray(colors[found]),
                    side="double",
                    lod="off",
                    cast_shadow=False,
                    receive_shadow=False,
                )
                if self._picked is not None:
                    self.nodes[shape].on_click(self._canvas.guarded(self._click(shape)))

    def _click(self, shape: int) -> Callable[[Any], None]:
        def clicked(event: Any) -> None:
            assert self._picked is not None
            found = self.rows[shape]
            index = event.instance_index
            if index is None:
                index = self._nearest(found, np.array(event.ray_origin), np.array(event.ray_direction))
            if 0 <= index < len(found):
                with self._canvas.lock:
                    self._picked(int(found[index]))

        return clicked

    def _nearest(self, found: NDArray[np.int64], origin: Floats, way: Floats) -> int:
        """Return the pose whose origin is nearest to a ray."""
        offsets = self._positions[found] - origin
        beside = offsets - (offsets @ way)[:, None] * way
        return int(np.linalg.norm(beside, axis=1).argmin())

    def remove(self) -> None:
        """Remove all nodes."""
        for node in self.nodes.values():
            node.remove()
        self.nodes.clear()
