"""Oriented boxes, and box decompositions of objects as binary trees."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from graspbox._common.by_value import ByValue

__all__ = ["Box", "BoxTree"]


@dataclass(frozen=True, eq=False)
class Box(ByValue):
    """An oriented box in the object's frame.

    Attributes
    ----------
    center : (3,) float64
        Metres.
    axes : (3, 3) float64
        Columns are the directions of the sides, longest first, right-handed.
    half_extents : (3,) float64
        Half of each side, metres.
    """

    center: NDArray[np.float64]
    axes: NDArray[np.float64]
    half_extents: NDArray[np.float64]

    @property
    def volume(self) -> float:
        """Volume, m3."""
        return float(8.0 * np.prod(self.half_extents))

    def corners(self) -> NDArray[np.float64]:
        """Return the corners, (8, 3), metres; the sign along the last axis changes fastest."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners: NDArray[np.float64] = self.center + (signs * self.half_extents) @ self.axes.T
        return corners

    def contains(self, points: NDArray[np.float64], tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Return a mask of the points (n, 3) inside the box, enlarged by `tolerance` metres on every side."""
        local = np.abs((points - self.center) @ self.axes)
        inside: NDArray[np.bool_] = np.all(local <= self.half_extents + tolerance, axis=1)
        return inside


@dataclass(frozen=True, eq=False)
class BoxTree(ByValue, Sequence[Box]):
    """A box decomposition: a binary tree whose leaves cover the object. As a sequence it contains the leaves.

    Attributes
    ----------
    nodes : tuple of Box
        All boxes, depth first: the root first, parents before children.
    children : (n, 2) int64
        Indices of each node's children; -1 for a leaf.
    depth : (n,) int64
        Cuts between the root and each node.
    """

    nodes: tuple[Box, ...]
    children: NDArray[np.int64]
    depth: NDArray[np.int64]

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The leaves, depth first."""
        return tuple(box for box, (low, _) in zip(self.nodes, self.children, strict=True) if low < 0)

    @property
    def volume(self) -> float:
        """Sum of the leaves' volumes, m3."""
        return sum(box.volume for box in self.boxes)

    @overload
    def __getitem__(self, index: int) -> Box: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Box, ...]: ...
    def __getitem__(self, index: int | slice) -> Box | tuple[Box, ...]:
        return self.boxes[index]

    def __len__(self) -> int:
        return len(self.boxes)

    def __iter__(self) -> Iterator[Box]:
        return iter(self.boxes)
