"""Training scenes rendered on demand: objects at rest, rendered by noisy depth cameras from any side.

The seed, the number and the settings determine a scene. Nothing is stored, and a resumed training gets the same
scenes as an uninterrupted one.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.hands import HandLike, cache_folder
from graspbox.layouts import SCALES, Arrangement, Layout, SceneLayout, arrange, draws, wall_points
from graspbox.meshes import Surroundings
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.crops import Crops, add_depth_noise, crop, solid_occupancy
from graspbox.views import ViewPlan, views

__all__ = ["Heap", "PlacedObjects", "SceneConfig", "SceneSampler", "Scenes", "look"]

#: Least and greatest number of objects of a scene of several: all stages of clearing it.
COUNTS: dict[Layout, tuple[int, int]] = {"packed": (1, 6), "pile": (1, 6), "bin": (1, 8)}
#: Ranges of the sides of a bin's floor along x and y, and of the height of its walls, metres.
BINS = ((0.2, 0.3), (0.2, 0.3), (0.06, 0.12))
#: Meshes that a sampler keeps ready to render; about 1 MB each.
_MESHES = 512
#: Scenes of several objects that a completion learns from, each seen again from other cameras: settling one takes
#: longer than a training step.
_HEAPS = 2048
#: Objects sampled until one has a resting pose, and scenes until one comes to rest.
_TRIES = 100
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class SceneConfig:
    """How scenes are rendered.

    Attributes
    ----------
    image_size : int
        Rows and columns.
    fov : pair of float
        Least and greatest vertical field of view, radians; one per object.
    distance : pair of float
        Least and greatest distance of the camera from the object's middle, metres.
    elevation : float
        Least angle of the camera above the horizon, radians.
    shift : float
        Greatest random offset of each camera coordinate, metres.
    noise : DepthNoise
        The camera's noise.
    crop : CropConfig
        The crop.
    """

    image_size: int = 128
    fov: tuple[float, float] = (0.45, 0.65)
    distance: tuple[float, float] = (0.45, 0.75)
    elevation: float = 0.45
    shift: float = 0.04
    noise: DepthNoise = field(default_factory=DepthNoise)
    crop: CropConfig = field(default_factory=CropConfig)


class Resting(NamedTuple):
    """An object and its resting poses."""

    mesh: Mesh
    #: ``world_from_object`` (k, 4, 4).
    poses: NDArray[np.float64]
    #: (k,), summing to 1.
    probabilities: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacedObjects:
    """Objects of a scene, and walls around them: a `graspbox.meshes.Surroundings`.

    Attributes
    ----------
    meshes : tuple of Mesh
        k objects.
    world_from_objects : (k, 4, 4) float64
        Their poses, metres.
    world_from_walls : (w, 4, 4) float64
        Poses of boxes.
    wall_half_extents : (w, 3) float64
        Their half extents, metres.
    """

    meshes: tuple[Mesh, ...]
    world_from_objects: NDArray[np.float64]
    world_from_walls: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    wall_half_extents: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, found: Arrangement) -> "PlacedObjects":
        """Take the objects and walls of an arrangement."""
        return cls(found.meshes, found.world_from_objects, found.world_from_walls, found.wall_half_extents)

    @property
    def middle(self) -> NDArray[np.float64]:
        """Middle of the bounds of all objects, (3,), metres."""
        corners = [pose[:3, :3] @ mesh.vertices.T + pose[:3, 3:] for mesh, pose in self]
        points = np.concatenate(corners, axis=1)
        return np.asarray((points.min(axis=1) + points.max(axis=1)) / 2)

    @property
    def obstacles(self) -> NDArray[np.float64]:
        """Points of the walls (k, 3), metres, from which grasps keep off: see `graspbox.layouts.wall_points`."""
        return wall_points(self.world_from_walls, self.wall_half_extents)

    def __iter__(self) -> Any:
        """Pair every object with its pose."""
        return iter(zip(self.meshes, self.world_from_objects, strict=True))

    def look(self, config: SceneConfig, seed: Sequence[int], count: int) -> Crops:
        """Render the scene with noisy cameras: see `look`."""
        mesh, pose = self.meshes[0], self.world_from_objects[0]
        if len(self.meshes) == 1 and not len(self.wall_half_extents):
            return look(mesh, pose, config, seed, count)
        return look(mesh, pose, config, seed, count, neighbours=self.others(), target=self.middle)

    def solid(self, crops: Crops, config: CropConfig) -> NDArray[np.uint8]:
        """Fill the voxels of n crops with the objects, not with the walls, (n, N, N, N); see `solid_occupancy`."""
        poses = np.linalg.inv(crops.world_from_crop)[:, None] @ self.world_from_objects
        of = np.tile(np.arange(len(self.meshes)), len(poses)).tolist()
        filled = solid_occupancy(self.meshes, of, poses.reshape(-1, 4, 4), config=config)
        return np.asarray(filled.reshape(*poses.shape[:2], *filled.shape[1:]).max(axis=1))

    def others(self) -> "PlacedObjects":
        """Return everything but the first object."""
        return PlacedObjects(
            self.meshes[1:], self.world_from_objects[1:], self.world_from_walls, self.wall_half_extents
        )


class Heap(NamedTuple):
    """A scene of several objects at rest."""

    #: Index of each object in the set, and its scale.
    objects: tuple[int, ...]
    scales: tuple[float, ...]
    arrangement: Arrangement


@dataclass(frozen=True, eq=False)
class Scenes:
    """n views of scenes at rest, in their crop frames.

    Attributes
    ----------
    placed : tuple of PlacedObjects
        The scenes.
    scene_of : (n,) int64
        The scene that each view shows, ascending.
    crops : Crops
        Crops from the noisy camera.
    """

    placed: tuple[PlacedObjects, ...]
    scene_of: NDArray[np.int64]
    crops: Crops

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.scene_of)

    def solids(self, config: CropConfig) -> NDArray[np.uint8]:
        """Return the ground-truth occupancy of each crop, (n, N, N, N) uint8: see `PlacedObjects.solid`."""
        filled = [placed.solid(self.crops.rows(self.scene_of == i), config) for i, placed in enumerate(self.placed)]
        return np.concatenate(filled)


def look(
    mesh: Mesh,
    world_from_object: NDArray[np.float64],
    config: SceneConfig,
    seed: Sequence[int],
    count: int,
    *,
    neighbours: Surroundings | None = None,
    target: NDArray[np.float64] | None = None,
) -> Crops:
    """Render an object with `count` noisy cameras; `seed` determines their poses and noise.

    `neighbours` are rendered with it; the cameras look at `target` (3,), by default the middle of the object.
    """
    rng = np.random.default_rng([int(one) for one in seed])
    fov = float(rng.uniform(*config.fov))
    plan = ViewPlan(
        "random",
        axis=(0.0, 0.0, 1.0),
        cap=float(np.pi / 2 - config.elevation),
        distance=config.distance,
        shift=config.shift,
    )
    first, noise = (int(one) for one in rng.integers(2**62, size=2))
    seen = views(
        mesh,
        plan=plan,
        count=count,
        seed=first,
        image_size=config.image_size,
        images="depth",
        fov=fov,
        levels=False,
        world_from_object=world_from_object,
        target=target,
        neighbours=neighbours,
    )
    depth = add_depth_noise(seen.depth, seen.intrinsics, noise, config.noise)
    return crop(depth, seen.intrinsics, seen.world_from_camera, config=config.crop)


class SceneSampler:
    """Samples scenes of a set of objects.

    Parameters
    ----------
    objects : ObjectSet
        The objects.
    config : SceneConfig
        How they are rendered.
    seed : int
        Seed of all scenes.
    layouts : sequence of str
        Layouts that scenes of trials have in turn: ``single``, or those of `graspbox.layouts`.
    physics : PhysicsConfig
        Settings of the physics engine for the trials.

    Raises
    ------
    ConfigError
        If the set is empty.
    """

    def __init__(
        self,
        objects: object_sets.ObjectSet,
        config: SceneConfig,
        seed: int,
        layouts: Sequence[SceneLayout] = ("single",),
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
    ) -> None:
        if not len(objects):
            raise ConfigError(f"the object set {objects.name!r} is empty; name objects to learn from")
        self.objects, self.config, self.seed, self.layouts = objects, config, seed, tuple(layouts)
        self.physics = physics

        @lru_cache(_MESHES)
        def resting(index: int) -> Resting | None:
            mesh = objects[index].load()
            try:
                poses, probabilities = mesh.resting_poses()
            except ConfigError as error:
                _LOG.warning("object %r is left out, since it has no resting pose: %s", mesh.name, error)
                return None
            return Resting(mesh, poses, probabilities / probabilities.sum())

        @lru_cache(_HEAPS)
        def heap(number: int, layout: Layout) -> PlacedObjects:
            rng = np.random.default_rng([self.seed, 1, number])
            for _ in range(_TRIES):
                try:
                    return PlacedObjects.of(self.heap(rng, layout).arrangement)
                except (MeshError, SimulationError):
                    continue
            raise ConfigError(f"{_TRIES} scenes of {self.objects.name!r} do not come to rest; choose other objects")

        self._resting, self._heap = resting, heap

    def rest(self, rng: np.random.Generator) -> tuple[int, Mesh, NDArray[np.float64]]:
        """Sample an object, by its index, and its resting pose ``world_from_object`` (4, 4).

        Objects without a resting pose are logged and skipped.

        Raises
        ------
        ConfigError
            If too many objects in a row have none.
        """
        for _ in range(_TRIES):
            index = int(rng.integers(len(self.objects)))
            found = self._resting(index)
            if found is not None:
                chosen = int(rng.choice(len(found.poses), p=found.probabilities))
                return index, found.mesh, found.poses[chosen]
        raise ConfigError(f"{_TRIES} objects of {self.objects.name!r} have no resting pose; choose other objects")

    def heap(self, rng: np.random.Generator, layout: Layout, hand: HandLike = "reflex") -> Heap:
        """Sample a scene of several objects; the hand stays out of the way.

        Raises
        ------
        MeshError, SimulationError
            If an object cannot be simulated, or none stays.
        """
        least, most = COUNTS[layout]
        count = int(rng.integers(least, most + 1))
        number = draws(layout, count)
        drawn = [self.rest(rng)[:2] for _ in range(number)]
        scales = rng.uniform(*SCALES[layout], size=number).round(6).tolist()
        inside = [float(rng.uniform(*sides)) for sides in BINS]
        meshes = [mesh.scaled(scale, cache_folder()) for (_, mesh), scale in zip(drawn, scales, strict=True)]
        found = arrange(meshes, layout, most=count, seed=int(rng.integers(2**62)), inside=inside, hand=hand)
        if not len(found):
            raise SimulationError("no object came to rest in the workspace; choose smaller objects")
        return Heap(tuple(drawn[i][0] for i in found.objects), tuple(scales[i] for i in found.objects), found)

    def sample(self, number: int, scenes: int, views: int) -> Scenes:
        """Sample scenes, each at rest and rendered from `views` cameras; the layouts take turns.

        Views without a visible object are left out.
        """
        rng = np.random.default_rng([self.seed, number])
        placed, found = [], []
        for i in range(scenes):
            layout = self.layouts[(number * scenes + i) % len(self.layouts)]
            if layout == "single":
                _, mesh, pose = self.rest(rng)
                placed.append(PlacedObjects((mesh,), pose[None]))
            else:
                placed.append(self._heap(int(rng.integers(_HEAPS)), layout))
            found.append(placed[-1].look(self.config, [self.seed, number, i + 1], views))
        crops = Crops.joined(found)
        of = np.repeat(np.arange(scenes), views)[crops.found]
        return Scenes(tuple(placed), of, crops.rows(crops.found))
