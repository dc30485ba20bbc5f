"""Hands in the scene: one hand with moving joints, and many grasp poses as small wire hands, both in few nodes."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.hands import Hand
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.geometry import BOX, CYLINDER, Color, Floats, split_all, sticks, wire_hand

__all__ = ["DrawnHand", "PoseSet"]

_PAD: Color = (92, 100, 112)
_BARE: Color = (176, 184, 196)
_HINGE: Color = (77, 82, 92)
#: Radius and half length of a hinge, as shares of the middle and the least half side of its link.
_RADIUS, _LENGTH = 1.1, 1.5
#: Radius of the sticks of a wire hand, metres.
_STICK = 0.0008
#: Most different shapes of wire hands in one set; preshapes between them take the nearest.
_MOST_SHAPES = 6


class DrawnHand:
    """A hand, drawn by its collision shapes and hinges: two nodes, whatever its number of joints.

    Parameters
    ----------
    canvas : Canvas
        Where to draw.
    name : str
        Name of its nodes.
    hand : Hand
        The hand.
    opacity : float, optional
        Between 0 and 1; by default opaque.
    """

    def __init__(self, canvas: Canvas, name: str, hand: Hand, opacity: float | None = None) -> None:
        self.hand, self._canvas = hand, canvas
        self.world_from_hand: Floats = np.eye(4)
        self.joints: Floats = hand.open(hand.preshape_limits[0])
        shapes, halves, pads, carriers = hand.shapes(self.joints)
        colors = np.where(pads[:, None], _PAD, _BARE).astype(np.uint8)
        self.shapes = self._node(f"{name}/shapes", BOX, len(halves), halves, colors, opacity)
        frames, _, revolute = hand.joint_frames(self.joints)
        self._hinges = [row for row in np.flatnonzero(revolute) if (carriers == row).any()]
        self._along = np.zeros(len(self._hinges))
        scales = np.ones((len(self._hinges), 3))
        for index, row in enumerate(self._hinges):
            link = int(np.where(carriers == row, halves.prod(axis=1), -1.0).argmax())
            least, middle, _ = np.sort(halves[link])
            self._along[index] = (shapes[link, :3, 3] - frames[row, :3, 3]) @ frames[row, :3, 0]
            scales[index] = _LENGTH * least, _RADIUS * middle, _RADIUS * middle
        self.hinges = None
        if self._hinges:
            dark = np.tile(np.array(_HINGE, dtype=np.uint8), (len(scales), 1))
            self.hinges = self._node(f"{name}/hinges", CYLINDER, len(scales), scales, dark, opacity)
        self.pose(self.world_from_hand, self.joints)

    def _node(self, name: str, solid: Any, count: int, scales: Any, colors: Any, opacity: float | None) -> Any:
        return self._canvas.scene.add_batched_meshes_simple(
            name,
            *solid,
            batched_wxyzs=np.tile(np.array([1.0, 0, 0, 0], dtype=np.float32), (count, 1)),
            batched_positions=np.zeros((count, 3), dtype=np.float32),
            batched_scales=np.asarray(scales, dtype=np.float32),
            batched_colors=colors,
            opacity=opacity,
            flat_shading=True,
            lod="off",
        )

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
        shapes = self.hand.shapes(self.joints)[0]
        self.shapes.batched_wxyzs, self.shapes.batched_positions = split_all(world_from_hand @ shapes)
        if self.hinges is not None:
            frames = self.hand.joint_frames(self.joints)[0][self._hinges]
            frames[:, :3, 3] += self._along[:, None] * frames[:, :3, 0]
            self.hinges.batched_wxyzs, self.hinges.batched_positions = split_all(world_from_hand @ frames)

    @property
    def visible(self) -> bool:
        """Whether it is shown."""
        return bool(self.shapes.visible)

    @visible.setter
    def visible(self, shown: bool) -> None:
        for node in self._nodes():
            node.visible = shown

    def _nodes(self) -> list[Any]:
        return [self.shapes] if self.hinges is None else [self.shapes, self.hinges]

    def remove(self) -> None:
        """Remove it from the scene."""
        for node in self._nodes():
            node.remove()


class PoseSet:
    """Grasp poses as small wire hands: one node of instances for each shape of the hand, for any number of poses.

    Parameters
    ----------
    canvas : Canvas
        Where to draw.
    name : str
        Name of its nodes.
    hand : Hand
        The hand.
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
        self._solids = [sticks(wire_hand(hand, float(value)), _STICK) for value in shapes]
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
        with self._canvas.server.atomic():
            for shape, solid in enumerate(self._solids):
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
