"""Geometric grasp planning: box decomposition of an object, and hand poses from the boxes."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, NamedTuple, Self, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, floats, with_settings
from graspbox._common.by_value import ByValue
from graspbox.arms import ArmLike, Reach, Trajectory, plan_path, reachable
from graspbox.configs import DecomposeConfig, PlanConfig, PoseConfig
from graspbox.errors import ConfigError, PlanError
from graspbox.hands import Hand, HandLike, cache_folder, load_hand
from graspbox.meshes import Mesh, MeshLike, Surroundings, as_mesh, mesh_from_arrays, placed
from graspbox.planning import plan_files
from graspbox.planning.boxes import Box, BoxTree

__all__ = [
    "Box",
    "BoxTree",
    "DecomposeSettings",
    "Grasp",
    "Plan",
    "PlanSettings",
    "TypicalGrasps",
    "decompose",
    "plan",
    "rank_weights",
    "typical_grasps",
]

#: Things of household size, metres: width, depth, and height of a box; of a cylinder without depth.
_TYPICAL = ((0.05, 0.05, 0.12), (0.04, 0.16, 0.06), (0.06, 0.0, 0.1), (0.07, 0.0, 0.22))
#: Vertical part of the direction of approach: down by more than the first is from above, by less than the second from
#: the side.
_ABOVE, _SIDE = 0.8, 0.5


class DecomposeSettings(TypedDict, total=False):
    """Fields of `graspbox.DecomposeConfig`, by name."""

    fit: Literal["minimum", "pca"]
    area_gain: float
    min_volume: float
    volume_gain: float | None
    max_boxes: int
    split_cost: Literal["share", "area"]
    samples: int
    seed: int


class PlanSettings(TypedDict, total=False):
    """Fields of `graspbox.PlanConfig`, by name; ``seed`` is a separate argument."""

    decompose: DecomposeConfig
    poses: PoseConfig
    clearance: float
    standoff: float
    max_press: float
    press_penalty: float


def decompose(
    mesh: MeshLike,
    config: DecomposeConfig = DecomposeConfig(),  # noqa: B008 (frozen)
    **settings: Unpack[DecomposeSettings],
) -> BoxTree:
    """Decompose an object into minimum-volume boxes.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    config : DecomposeConfig
        Settings of the decomposition.
    **settings
        Fields of `DecomposeConfig` by name, instead of those of `config`: ``fit="pca"``, ``max_boxes=8``, ...

    Returns
    -------
    BoxTree
        Boxes in the object's frame; the leaves together contain the whole surface (within 1e-6 m).

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
    params = config_dict(with_settings(config, DecomposeConfig, settings))
    return _tree(_core.decompose(as_mesh(mesh), params))


def _tree(arrays: Mapping[str, Any]) -> BoxTree:
    rows = zip(arrays["center"], arrays["axes"], arrays["half_extents"], strict=True)
    return BoxTree(tuple(Box(*row) for row in rows), arrays["children"], arrays["depth"])


@dataclass(frozen=True, eq=False)
class Grasp(ByValue):
    """One candidate of a `Plan`: a row of its columns, where they are explained; `pose` is a row of ``poses``."""

    pose: NDArray[np.float64]
    preshape: float
    feasible: bool
    score: float
    box: int
    face: int
    touch: float = 0.0
    press: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Plan(ByValue):
    """Candidate grasps of an object: n rows, the feasible ones first, each group in ranking order.

    ``plan[3]`` is a `Grasp`; a slice, a mask or an array of indices gives a plan of these rows, and iteration yields
    grasps. Plans can be pickled, and saved as JSON. Two are equal if all their values are; NaN equals NaN.

    Attributes
    ----------
    poses : (n, 4, 4) float64
        ``object_from_hand``, metres.
    preshape : (n,) float64
        Radians.
    feasible : (n,) bool
        Whether the open hand, at the pose and on the approach, collides with nothing but neighbours that it may push
        aside (`PlanConfig.max_press`): those of at most 6 kg, where the approach does not begin in them.
    score : (n,) float64
        Higher is better; comparable only within this plan. It depends only on geometry.
    box, face : (n,) int64
        Leaf of the tree that a pose comes from (the number of leaves denotes the box around the whole object), and its
        face: ``2 axis`` on the positive side of the box's axis, ``2 axis + 1`` on the negative.
    touch : (n,) float64
        Deepest penetration of a neighbour by the open hand on its approach, metres; 0 where it touches none, and for
        poses that are not feasible.
    press : (n,) float64
        How far the open hand pushes a neighbour down, metres, where its support resists: penetration times the cosine
        between down and the normal of the first contact, the greatest of all contacts; 0 for a push sideways or up.
    tree : BoxTree
        The boxes.
    world_from_object : (4, 4) float64
        Resting pose of the object; the table is the plane z = 0.
    features : (n, k) float64 or None
        With ``features=True``: terms of the ranking, one column per name of `rank_weights`; NaN for poses that are not
        feasible. The score is their sum weighted by `rank_weights`, minus `PlanConfig.press_penalty` times ``press``,
        minus a small penalty per better-ranked pose of the same box, face and preshape.
    name, mesh_sha256, hand_name : str
        The object's name, the hash of its mesh (`graspbox.planning.plan_files.mesh_hash`), and the hand's name.
    source, scale, mass : str, float, float or None
        Where a command loaded the object from, for `graspbox.object_sets.load`: a set of it alone, empty if it is not
        known, metres per unit of its file, and kilograms, None if they follow from the set.
    """

    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    feasible: NDArray[np.bool_]
    score: NDArray[np.float64]
    box: NDArray[np.int64]
    face: NDArray[np.int64]
    touch: NDArray[np.float64]
    press: NDArray[np.float64]
    tree: BoxTree
    world_from_object: NDArray[np.float64]
    features: NDArray[np.float64] | None = None
    name: str = ""
    mesh_sha256: str = ""
    hand_name: str = ""
    source: str = ""
    scale: float = 1.0
    mass: float | None = None

    def __len__(self) -> int:
        return len(self.poses)

    def __repr__(self) -> str:
        return (
            f"Plan({self.name!r}, poses={len(self)}, feasible={int(self.feasible.sum())}, "
            f"boxes={len(self.tree)}, hand={self.hand_name!r})"
        )

    @overload
    def __getitem__(self, index: int) -> Grasp: ...
    @overload
    def __getitem__(self, index: slice | NDArray[Any] | list[int]) -> Self: ...
    def __getitem__(self, index: int | slice | NDArray[Any] | list[int]) -> "Grasp | Self":
        if isinstance(index, int | np.integer):
            row = [getattr(self, name)[index] for name in _ROWS]
            return Grasp(row[0].copy(), *(value.item() for value in row[1:]))
        kept = np.arange(len(self))[index]
        names = _ROWS if self.features is None else (*_ROWS, "features")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})

    def __iter__(self) -> Iterator[Grasp]:
        return (self[i] for i in range(len(self)))

    def best(self, count: int | None = None) -> Self:
        """Return the first `count` feasible candidates, in ranking order; by default all of them.

        Raises
        ------
        ConfigError
            If `count` is negative.
        """
        if count is not None and count < 0:
            raise ConfigError(f"count is {count}; give the number of poses to keep, or None for all feasible ones")
        return self[np.flatnonzero(self.feasible)[:count]]

    def reachable(
        self,
        arm: ArmLike,
        world_from_base: ArrayLike,
        *,
        hand: HandLike | None = None,
        mesh: MeshLike | None = None,
        **around: Any,
    ) -> Reach:
        """Find which grasps an arm reaches, by which joints, and why it does not reach the others.

        ``plan[reach.reached & plan.feasible]`` are the grasps that it can carry out, in ranking order.

        Parameters
        ----------
        arm : str, Arm or pair of paths
            See `graspbox.arms.load_arm`.
        world_from_base : (4, 4) array_like
            Pose of the arm's base, metres; the table is the plane z = 0.
        hand : str, Hand or pair of paths, optional
            The hand of the plan; by default the included one of its name.
        mesh : Mesh, optional
            The object, which the links must not touch either.
        **around
            Further arguments of `graspbox.arms.reachable`: ``mount``, ``points``, ``objects``, ``neighbours``,
            ``config``, ``num_threads``.

        Raises
        ------
        ArmError, ConfigError
            As `graspbox.arms.reachable`, and for a hand other than the plan's.
        """
        loaded = self._hand(hand)
        own = [] if mesh is None else [(mesh, self.world_from_object)]
        objects = [*own, *(around.pop("objects", None) or [])]
        poses = self.world_from_object @ self.poses
        return reachable(arm, loaded, poses, self.preshape, world_from_base, objects=objects, **around)

    def path(
        self,
        arm: ArmLike,
        world_from_base: ArrayLike,
        *,
        hand: HandLike | None = None,
        mesh: MeshLike | None = None,
        **options: Any,
    ) -> Trajectory:
        """Plan a timed path of an arm to the first feasible grasp that has one, in ranking order.

        Parameters
        ----------
        arm : str, Arm or pair of paths
            See `graspbox.arms.load_arm`.
        world_from_base : (4, 4) array_like
            Pose of the arm's base, metres; the table is the plane z = 0.
        hand : str, Hand or pair of paths, optional
            The hand of the plan; by default the included one of its name.
        mesh : Mesh, optional
            The object, which is then carried.
        **options
            Further arguments of `graspbox.arms.plan_path`: ``place``, ``objects``, ``neighbours``, ``points``,
            ``config``, ``speed``, ...

        Returns
        -------
        Trajectory
            Its ``grasp`` is an index of the plan's feasible grasps, ``plan[plan.feasible]``.

        Raises
        ------
        PlanError
            If no grasp of the plan is feasible.
        PathError, ArmError, ConfigError, MissingExtraError
            As `graspbox.arms.plan_path`, and for a hand other than the plan's.
        """
        loaded = self._hand(hand)
        if not self.feasible.any():
            raise PlanError("no grasp of the plan is feasible, so none needs a path")
        poses = (self.world_from_object @ self.poses)[self.feasible]
        target = None if mesh is None else (mesh, self.world_from_object)
        return plan_path(arm, loaded, poses, self.preshape[self.feasible], world_from_base, target=target, **options)

    def _hand(self, hand: HandLike | None) -> Hand:
        """Return the hand of the plan."""
        if hand is None and self.hand_name not in Hand.names():
            raise ConfigError(f"the plan is for the hand {self.hand_name!r}, which is not included; pass it as hand")
        loaded = load_hand(self.hand_name if hand is None else hand)
        if loaded.name != self.hand_name:
            raise ConfigError(f"the plan is for the hand {self.hand_name!r}, not {loaded.name!r}; pass that hand")
        return loaded

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the plan as JSON, in the format of `graspbox.planning.plan_files`; `load` restores it bit for bit.

        The file is replaced atomically.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        facts = {name: getattr(self, name) for name in _FACTS}
        plan_files.write(path, facts, _tree_columns(self.tree), {name: getattr(self, name) for name in _ROWS})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a plan written by `save`.

        Raises
        ------
        FileError
            If the file cannot be read, or is larger than 256 MiB.
        PlanError
            If it contains no valid plan; the message names the wrong part.
        """
        facts, boxes, grasps = plan_files.read(path)
        columns: dict[str, Any] = {**grasps, **facts}
        return cls(tree=_tree(boxes), **columns)


#: Columns of a plan, in the order of the fields of `Grasp`.
_ROWS = tuple("poses" if f.name == "pose" else f.name for f in fields(Grasp))
#: Attributes of a plan other than its columns and its tree.
_FACTS = ("name", "mesh_sha256", "hand_name", "source", "scale", "mass", "world_from_object", "features")


def _tree_columns(tree: BoxTree) -> dict[str, NDArray[Any]]:
    names = [f.name for f in fields(Box)]
    columns = {name: np.stack([getattr(box, name) for box in tree.nodes]) for name in names}
    return {**columns, "children": tree.children, "depth": tree.depth}


def plan(
    mesh: MeshLike,
    *,
    hand: HandLike = "reflex",
    seed: int | None = None,
    world_from_object: ArrayLike | None = None,
    config: PlanConfig = PlanConfig(),  # noqa: B008 (frozen)
    num_threads: int | None = None,
    features: bool = False,
    neighbours: Surroundings | None = None,
    **settings: Unpack[PlanSettings],
) -> Plan:
    """Generate hand poses from an object's boxes, filter out collisions, and rank the rest by geometry.

    Parameters
    ----------
    mesh : Mesh
        The object; another library's mesh is converted (`graspbox.meshes.as_mesh`).
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    seed : int, optional
        Seed of the random variations, instead of that of `config`.
    world_from_object : (4, 4) array_like, optional
        Resting pose of the object on the table (top at z = 0). By default the file's +z is up, the lowest vertex at
        z = 0, and the bounds are centred above the origin; `graspbox.Scene` simulates how the object comes to rest.
    config : PlanConfig
        Settings of the planner.
    num_threads : int, optional
        Number of threads, 1 to 1024; by default ``GRASPBOX_THREADS``, else all cores. Results do not depend on it.
    features : bool
        Whether to return the terms of the ranking for each pose.
    neighbours : Surroundings, optional
        Other objects and walls, which the open hand must not touch, or may push aside (`PlanConfig.max_press`): what
        `graspbox.Arrangement.without` returns.
    **settings
        Fields of `PlanConfig` by name, instead of those of `config`.

    Raises
    ------
    ConfigError
        If a setting is out of range.
    PlanError
        If the object is flat, or the planner does not support the hand.
    """
    mesh, hand = as_mesh(mesh), load_hand(hand)
    chosen = {**settings} if seed is None else {**settings, "seed": seed}
    params = config_dict(with_settings(config, PlanConfig, chosen))
    pose = None if world_from_object is None else floats(world_from_object, "world_from_object")
    around, walls = placed(neighbours)
    arrays = _core.plan(mesh, hand, params, pose, cache_folder(), num_threads, features, around, walls)
    columns: dict[str, Any] = {name: arrays[name] for name in _ROWS}  # type: ignore[literal-required]
    return Plan(
        **columns,
        tree=_tree(arrays["tree"]),
        world_from_object=arrays["world_from_object"],
        features=arrays.get("features"),
        name=mesh.name,
        mesh_sha256=plan_files.mesh_hash(mesh),
        hand_name=hand.name,
    )


def rank_weights(hand: HandLike = "reflex") -> dict[str, float]:
    """Return name and weight of each term of the ranking, in the order of the columns of `Plan.features`.

    ``scripts/fit_ranking.py`` refits the weights.
    """
    return dict(_core.rank_weights(load_hand(hand)))


class TypicalGrasps(NamedTuple):
    """Grasps of things that stand on the table's origin.

    Attributes
    ----------
    poses : (n, 4, 4) float64
        ``table_from_hand``, metres.
    preshape : (n,) float64
        See `graspbox.Hand.preshape_limits`.
    above : (n,) bool
        Whether the hand comes from above; else it comes from the side.
    """

    poses: NDArray[np.float64]
    preshape: NDArray[np.float64]
    above: NDArray[np.bool_]


def typical_grasps(
    hand: HandLike = "reflex",
    *,
    objects: Sequence[MeshLike] | None = None,
    each: int = 2,
    seed: int = 0,
    num_threads: int | None = None,
) -> TypicalGrasps:
    """Plan some grasps from above and some from the side, for what an arm reaches (`graspbox.arms.reach_map`).

    Parameters
    ----------
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    objects : sequence of Mesh, optional
        Things, z up; by default two boxes and two cylinders, 6 to 22 cm high.
    each : int
        Most grasps of each thing from above, and as many from the side: the best of the ranking.
    seed, num_threads
        As of `plan`.

    Raises
    ------
    ConfigError
        If `each` is below 1.
    PlanError
        If the hand grasps none of the things, or the planner does not support it.
    """
    if each < 1:
        raise ConfigError(f"each is {each}; pass 1 or more grasps per thing and direction")
    loaded, found = load_hand(hand), []
    for mesh in [_solid(*sides) for sides in _TYPICAL] if objects is None else objects:
        best = plan(mesh, hand=loaded, seed=seed, num_threads=num_threads).best()
        poses = best.world_from_object @ best.poses
        down = -poses[:, 2, 2]
        for rows in (down > _ABOVE, np.abs(down) < _SIDE):
            kept = np.flatnonzero(rows)[:each]
            found.append((poses[kept], best.preshape[kept], down[kept] > _ABOVE))
    if not sum(len(poses) for poses, _, _ in found):
        raise PlanError(f"the hand {loaded.name} grasps none of the things from above or from the side; pass others")
    poses, preshape, above = (np.concatenate(column) for column in zip(*found, strict=True))
    return TypicalGrasps(poses, preshape, above)


def _solid(width: float, depth: float, height: float) -> Mesh:
    """Make a box, or a cylinder if it has no depth."""
    sides = 4 if depth else 32
    turns = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    reach = np.array([width, depth]) / np.sqrt(2.0) if depth else np.array([width, width]) / 2
    outline = reach * np.column_stack([np.cos(turns), np.sin(turns)])
    corners = np.concatenate([np.column_stack([outline, np.full(sides, z)]) for z in (0.0, height)])
    ring = np.arange(sides)
    after = (ring + 1) % sides
    around = [np.column_stack([ring, after, sides + ring]), np.column_stack([after, sides + after, sides + ring])]
    fan = np.column_stack([np.zeros(sides - 2, dtype=np.int64), ring[1:-1], ring[2:]])
    faces = np.concatenate([*around, fan[:, ::-1], sides + fan])
    return mesh_from_arrays(corners, faces, name="box" if depth else "cylinder")
