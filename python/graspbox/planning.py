"""Planning is purely geometric: boxes around an object, and hand poses from the boxes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._core import Mesh
from graspbox.configs import DecomposeConfig, PlanConfig
from graspbox.meshes import floats, to_json
from graspbox.simulation import Hand, cache_folder, load_hand

__all__ = ["Box", "BoxTree", "Plan", "decompose", "plan", "rank_weights"]


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
    return _tree(_core.decompose(mesh, to_json(replace(config, **settings))))


def _tree(arrays: "_core.BoxArrays") -> BoxTree:
    rows = zip(arrays["center"], arrays["axes"], arrays["half_extents"], strict=True)
    return BoxTree(tuple(Box(*row) for row in rows), arrays["children"], arrays["depth"])


@dataclass(frozen=True, eq=False)
class Plan:
    """Candidate grasps of an object: n rows, the feasible ones first, the planner's best guess first of all.

    Attributes
    ----------
    poses : (n, 4, 4) float64
        ``object_from_hand``, metres.
    preshape : (n,) float64
        Radians.
    feasible : (n,) bool
        The open hand collides with neither object nor table, at the pose and on the approach.
    score : (n,) float64
        Higher is better, within this plan; from geometry alone.
    box, face : (n,) int64
        Leaf of the tree that a pose comes from (the number of leaves stands for the box around the whole object), and
        the face: ``2 axis`` on the positive side of the box's axis, ``2 axis + 1`` on the negative.
    tree : BoxTree
        The boxes.
    world_from_object : (4, 4) float64
        Where the object rests; the table is the plane z = 0.
    features : (n, k) float64 or None
        If asked for: what the ranking read off each pose, one column for each name of `rank_weights`; NaN where a pose
        is not feasible. Their sum weighted by `rank_weights`, less a little for every better pose of the same box, face
        and preshape, is the score.
    """

    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    feasible: NDArray[np.bool_]
    score: NDArray[np.float64]
    box: NDArray[np.int64]
    face: NDArray[np.int64]
    tree: BoxTree
    world_from_object: NDArray[np.float64]
    features: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.poses)

    def best(self, count: int | None = None) -> "Plan":
        """Keep the first `count` feasible candidates, in ranking order; all feasible ones by default."""
        ranked = np.flatnonzero(self.feasible)[:count]
        rows = ["poses", "preshape", "feasible", "score", "box", "face"]
        if self.features is not None:
            rows.append("features")
        return replace(self, **{name: getattr(self, name)[ranked] for name in rows})


def plan(
    mesh: Mesh,
    *,
    hand: str | Hand | tuple[str, str] = "reflex",
    seed: int | None = None,
    world_from_object: ArrayLike | None = None,
    config: PlanConfig = PlanConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
    features: bool = False,
    **settings: Any,
) -> Plan:
    """Propose hand poses from an object's boxes, drop those that collide, and rank the rest by geometry alone.

    Parameters
    ----------
    mesh : Mesh
        The object.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    seed : int, optional
        Seed of the random variations, instead of that of `config`.
    world_from_object : (4, 4) array_like, optional
        Where the object rests on the table (top at z = 0). By default the file's +z is up, the lowest vertex at z =
        0, the bounds centred over the origin; `graspbox.Scene` tells where it really comes to rest.
    config : PlanConfig
        How to plan.
    num_threads : int, optional
        Threads to use; the result does not depend on it.
    features : bool
        Also return what the ranking read off each pose.
    **settings
        Fields of `PlanConfig` by name, instead of those of `config`.

    Raises
    ------
    ConfigError
        If a setting is out of range.
    PlanError
        If the object is flat, or the hand is not one that the planner knows.
    """
    if seed is not None:
        settings["seed"] = seed
    pose = None if world_from_object is None else floats(world_from_object)
    settled = to_json(replace(config, **settings))
    arrays = _core.plan(mesh, load_hand(hand), settled, pose, cache_folder(), num_threads, features)
    return Plan(
        poses=arrays["poses"],
        preshape=arrays["preshape"],
        feasible=arrays["feasible"],
        score=arrays["score"],
        box=arrays["box"],
        face=arrays["face"],
        tree=_tree(arrays["tree"]),
        world_from_object=arrays["world_from_object"],
        features=arrays.get("features"),
    )


def rank_weights() -> dict[str, float]:
    """Name and weight of each term of the ranking, in the order of the columns of `Plan.features`.

    ``scripts/fit_ranking.py`` fits them again.
    """
    return dict(_core.rank_weights())
