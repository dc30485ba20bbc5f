"""Several objects at rest on the table: packed, in a pile, in a bin.

Packed scenes and piles follow the two generators of VGN (Breyer et al., "Volumetric Grasping Network", 2020;
``ethz-asl/vgn``, ``simulation.py``), in a workspace of 0.3 m about the middle of the table:

| layout | how it is made | scale of the objects |
|---|---|---|
| ``packed`` | upright, turned about z, one by one within 7 cm of the middle, where nothing is touched | 0.7 to 0.9 |
| ``pile`` | dropped one by one, in any orientation, from 0.2 m into a box that is then removed | 0.8 to 1.0 |
| ``bin`` | the same into a bin, which stays; ours | 1.0 |

Objects are drawn with replacement. A packed scene of drawn objects ends after 12 attempts, each with another object, or
once the wanted number stands. The table of all numbers, and where they differ from VGN's, heads
``env/episode/src/layout.rs``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict, natural
from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.caching import cache_folder
from graspbox.meshes import Mesh, MeshLike, as_mesh
from graspbox.object_sets import ObjectSet, ObjectSpec

__all__ = [
    "SCALES",
    "Arrangement",
    "Layout",
    "SceneLayout",
    "arrange",
    "bin_points",
    "draw_objects",
    "draws",
    "layout_named",
    "objects_that_fit",
    "scaled",
    "scene_layout_named",
    "wall_points",
]

Layout = Literal["packed", "pile", "bin"]
#: A layout, or a single object in one of its resting poses.
SceneLayout = Literal["single", "packed", "pile", "bin"]

#: Least and greatest scale of the objects of each layout.
SCALES: dict[Layout, tuple[float, float]] = {"packed": (0.7, 0.9), "pile": (0.8, 1.0), "bin": (1.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Objects at rest on the table; the world's frame has its origin in the middle of the table top, z up.

    Attributes
    ----------
    layout : str
        ``packed``, ``pile`` or ``bin``.
    objects : tuple of int
        Indices of the objects that stayed, ascending; the others did not fit, fell out of the workspace, or were
        drawn for attempts that the scene did not need.
    meshes : tuple of Mesh
        The objects that stayed.
    world_from_objects : (k, 4, 4) array
        Their poses.
    world_from_walls : (w, 4, 4) array
        Poses of the walls of a bin.
    wall_half_extents : (w, 3) array
        Half extents of these boxes, metres.
    target : int, optional
        Index, among the objects that stayed, of the one that is to be grasped; None if any of them may be.
    """

    layout: Layout
    objects: tuple[int, ...]
    meshes: tuple[Mesh, ...]
    world_from_objects: NDArray[np.float64]
    world_from_walls: NDArray[np.float64]
    wall_half_extents: NDArray[np.float64]
    target: int | None = None

    @classmethod
    def of_one(cls, mesh: Mesh, world_from_object: NDArray[np.float64]) -> "Arrangement":
        """Place a single object at a pose (4, 4), metres, without walls."""
        return cls("packed", (0,), (mesh,), world_from_object[None], np.zeros((0, 4, 4)), np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.objects)

    def top(self) -> float:
        """Height of the highest point of objects and walls above the table, metres; 0 for none."""
        objects = zip(self.meshes, self.world_from_objects, strict=True)
        heights = [float((mesh.vertices @ pose[2, :3]).max() + pose[2, 3]) for mesh, pose in objects]
        walls = zip(self.wall_half_extents, self.world_from_walls, strict=True)
        heights += [float(np.abs(pose[2, :3]) @ half + pose[2, 3]) for half, pose in walls]
        return max(heights, default=0.0)

    def without(self, index: int) -> "Arrangement":
        """Return the same scene without one object; `index` counts those that are here.

        Raises
        ------
        ConfigError
            If there is no such object.
        """
        if not 0 <= index < len(self):
            raise ConfigError(f"there is no object {index} of {len(self)}; count from 0")
        target = self.target
        if target is not None:
            target = None if target == index else target - (index < target)
        return replace(
            self,
            target=target,
            objects=self.objects[:index] + self.objects[index + 1 :],
            meshes=self.meshes[:index] + self.meshes[index + 1 :],
            world_from_objects=np.delete(self.world_from_objects, index, axis=0),
        )

    def __repr__(self) -> str:
        names = ", ".join(mesh.name for mesh in self.meshes)
        return f"Arrangement({self.layout!r}, {len(self)} objects: {names})"


def arrange(
    objects: Sequence[MeshLike],
    layout: Layout = "pile",
    *,
    most: int | None = None,
    spread: float = 1.0,
    seed: int = 0,
    inside: Sequence[float] = (0.3, 0.25, 0.12),
    hand: HandLike = "reflex",
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
) -> Arrangement:
    """Let objects come to rest in a layout; equal arguments give equal bits.

    Parameters
    ----------
    objects : sequence of Mesh
        1 to 64 objects; meshes of other libraries are converted (`graspbox.meshes.as_mesh`).
    layout : str
        ``packed``, ``pile`` or ``bin``.
    most : int, optional
        Number of objects that the scene is to have, of objects drawn at random for it
        (`graspbox.simulation.layouts.draw_objects`): they are taken in order, one attempt each, until it is reached. By
        default all of them are wanted, and each has up to 12 attempts to stand in a packed scene.
    spread : float
        Objects are put or dropped within this many times the distance of the table above from the middle, 0.25 to 2:
        below 1 they lie closer together.
    seed : int
        Seed of places and orientations.
    inside : (3,) sequence of float
        Sides of the bin's floor along x and y, and height of its walls, metres, 0.02 to 1.
    hand : str, Hand or pair of paths
        The hand, which touches nothing.
    physics : PhysicsConfig
        Settings of the physics engine.

    Raises
    ------
    ConfigError
        For another layout, a wrong `most`, or a spread or sides out of range.
    SimulationError
        For no object, too many objects, or one that cannot be simulated.
    """
    layout = layout_named(layout)
    meshes = [as_mesh(mesh) for mesh in objects]
    shape: Any = {"bin": {"inside": _sides(inside)}} if layout == "bin" else layout
    found = _core.arrange(
        meshes,
        None if most is None else natural(most, "most"),
        spread,
        load_hand(hand),
        shape,
        config_dict(physics, PhysicsConfig, "physics"),
        natural(seed, "seed", 64),
        cache_folder(),
    )
    kept = tuple(int(index) for index in found["objects"])
    return Arrangement(
        layout=layout,
        objects=kept,
        meshes=tuple(meshes[index] for index in kept),
        world_from_objects=found["world_from_objects"],
        world_from_walls=found["world_from_walls"],
        wall_half_extents=found["wall_half_extents"],
    )


def bin_points(inside: Sequence[float], *, spacing: float = 0.008, inset: float = 0.004) -> NDArray[np.float64]:
    """Fill the walls of a bin with points, which show a collision search where they are.

    Parameters
    ----------
    inside : three float
        Sides of its floor along x and y, and height of its walls, metres.
    spacing : float
        Greatest distance between neighbours along an axis of a wall, metres.
    inset : float
        Depth of the outermost points below the faces of a wall, metres: a search with cells of 4 mm would otherwise
        refuse a hand that passes next to the wall.

    Returns
    -------
    (k, 3) float64
        World frame, metres.

    Raises
    ------
    ConfigError
        For sides, a spacing or an inset out of range.
    """
    if not 0.001 <= spacing <= 1.0:
        raise ConfigError(f"spacing is {spacing!r}; give 0.001 to 1 m")
    if not 0.0 <= inset <= 0.01:
        raise ConfigError(f"inset is {inset!r}; give 0 to 0.01 m, half the thickness of a wall")
    walls = _core.bin_walls(_sides(inside))
    return wall_points(walls["world_from_walls"], walls["wall_half_extents"], spacing=spacing, inset=inset)


def wall_points(
    world_from_walls: NDArray[np.float64],
    wall_half_extents: NDArray[np.float64],
    *,
    spacing: float = 0.008,
    inset: float = 0.004,
) -> NDArray[np.float64]:
    """Fill walls, as of an `Arrangement`, with points (k, 3); arguments as of `bin_points`. No walls have none."""
    parts = [np.zeros((0, 3))]
    for pose, half in zip(world_from_walls, wall_half_extents, strict=True):
        sides = np.maximum(half - inset, 0.0)
        axes = [np.linspace(-side, side, int(np.ceil(2 * side / spacing)) + 1) for side in sides]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        parts.append(grid @ pose[:3, :3].T + pose[:3, 3])
    return np.concatenate(parts)


def draw_objects(specs: Sequence[ObjectSpec], count: int, layout: Layout, seed: int) -> list[ObjectSpec]:
    """Draw objects at random for a scene, any of them more than once, each at a random scale (`SCALES`).

    Parameters
    ----------
    specs : sequence of ObjectSpec
        Objects to choose from.
    count : int
        Number of objects that the scene is to have, 1 or more.
    layout : str
        ``packed``, ``pile`` or ``bin``.
    seed : int
        Seed of the choice.

    Returns
    -------
    list of ObjectSpec
        `count` objects; for ``packed`` 12, one per attempt to place one (the argument `most` of `graspbox.arrange`).

    Raises
    ------
    ConfigError
        For another layout, a count below 1, or no object to choose from.
    """
    layout = layout_named(layout)
    if count < 1 or not specs:
        raise ConfigError(f"{count} of {len(specs)} objects cannot be drawn; give 1 or more of each")
    random = np.random.default_rng([seed, 1])
    number = draws(layout, count)
    chosen = random.choice(len(specs), size=number)
    scales = random.uniform(*SCALES[layout], size=number)
    return [scaled(specs[int(index)], float(scale)) for index, scale in zip(chosen, scales, strict=True)]


def draws(layout: Layout, count: int) -> int:
    """Return the number of objects to draw for a scene of `count`: of a packed scene, its attempts."""
    return _core.PACKED_ATTEMPTS if layout == "packed" else count


def objects_that_fit(objects: ObjectSet, layout: Layout, hand: HandLike) -> ObjectSet:
    """Leave out objects that are too wide for a hand.

    An object fits if its least width in plan view, at the greatest scale of the layout, is at most the hand's widest
    opening: upright in packed scenes, else in resting poses whose probabilities sum to 1/2 or more. One without a
    resting pose does not fit. The result may be empty.

    Raises
    ------
    ConfigError
        For another layout or hand.
    """
    widest, largest = load_hand(hand).widest, SCALES[layout_named(layout)][1]
    if widest == float("inf"):
        return objects

    def fits(spec: ObjectSpec) -> bool:
        mesh = spec.load()
        if layout == "packed":
            return largest * mesh.least_width(np.eye(4)) <= widest
        try:
            poses, probabilities = mesh.resting_poses()
        except ConfigError:
            return False
        narrow = [largest * mesh.least_width(pose) <= widest for pose in poses]
        return bool(probabilities[narrow].sum() >= 0.5 * probabilities.sum())

    return replace(objects, objects=tuple(spec for spec in objects if fits(spec)))


def layout_named(name: str) -> Layout:
    """Check the name of a layout: raise ConfigError for another one."""
    if name not in get_args(Layout):
        raise ConfigError(f"layout is {name!r}; choose from {', '.join(get_args(Layout))}")
    return cast("Layout", name)


def scene_layout_named(name: str) -> SceneLayout:
    """Check the name of a layout, or ``single``: raise ConfigError for another one."""
    if name not in get_args(SceneLayout):
        raise ConfigError(f"layout is {name!r}; choose from {', '.join(get_args(SceneLayout))}")
    return cast("SceneLayout", name)


def scaled(spec: ObjectSpec, factor: float) -> ObjectSpec:
    """Scale an object and, where its mass does not follow from its volume, its mass."""
    mass = None if spec.mass is None else spec.mass * factor**3
    return replace(spec, scale=spec.scale * factor, mass=mass)


def _sides(inside: Sequence[float]) -> list[float]:
    try:
        x, y, z = (float(side) for side in inside)
    except (TypeError, ValueError):
        raise ConfigError(f"inside is {inside!r}; give three numbers: two sides and a height, metres") from None
    if not all(np.isfinite([x, y, z])):
        raise ConfigError(f"inside is {inside!r}; give finite numbers, metres")
    return [x, y, z]
