"""Planning is purely geometric: boxes around an object, and hand poses from the boxes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._core import Mesh
from graspbox.configs import DecomposeConfig
from graspbox.meshes import to_json

__all__ = ["Box", "BoxTree", "decompose"]


@dataclass(frozen=True, eq=False)
class Box:
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
        """Corners, (8, 3), metres: the last axis changes fastest."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
        corners: NDArray[np.float64] = self.center + (signs * self.half_extents) @ self.axes.T
        return corners

    def contains(self, points: NDArray[np.float64], tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Which of the points (n, 3) lie in the box grown by `tolerance` metres."""
        local = np.abs((points - self.center) @ self.axes)
        inside: NDArray[np.bool_] = np.all(local <= self.half_extents + tolerance, axis=1)
        return inside


@dataclass(frozen=True, eq=False)
class BoxTree(Sequence[Box]):
    """A box decomposition: a binary tree of boxes, depth first; its leaves cover the object. As a sequence: the leaves.

    Attributes
    ----------
    nodes : tuple of Box
        All boxes; the root first, parents before children.
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


def decompose(mesh: Mesh, config: DecomposeConfig = DecomposeConfig(), **settings: Any) -> BoxTree:  # noqa: B008 (frozen)
    """Cut an object into minimum-volume boxes.

    Parameters
    ----------
    mesh : Mesh
        The object.
    config : DecomposeConfig
        How to cut.
    **settings
        Fields of `DecomposeConfig` by name, instead of those of `config`: ``fit="pca"``, ``max_boxes=8``, ...

    Returns
    -------
    BoxTree
        In the object's frame; the leaves together contain the whole surface (within 1e-6 m).

    Raises
    ------
    ConfigError
        If a setting is out of range.
    PlanError
        If the object is flat.

    References
    ----------
    K. Huebner, S. Ruthotto, D. Kragic, "Minimum volume bounding box decomposition for shape approximation
    in robot grasping", ICRA 2008.
    """
    arrays = _core.decompose(mesh, to_json(replace(config, **settings)))
    rows = zip(arrays["center"], arrays["axes"], arrays["half_extents"], strict=True)
    return BoxTree(tuple(Box(*row) for row in rows), arrays["children"], arrays["depth"])
