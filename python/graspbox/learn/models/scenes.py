"""Training scenes rendered on demand: objects at rest, rendered by noisy depth cameras from any side.

The seed, the number and the settings determine a scene. Nothing is stored, and a resumed training gets the same
scenes as an uninterrupted one.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.hands import HandLike, cache_folder
from graspbox.meshes import Surroundings
from graspbox.meshes.views import ViewPlan, views
from graspbox.perception.captured import crop_of_a_thing
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.crops import Crops, add_depth_noise, crop, solid_occupancy
from graspbox.perception.depth_views import DepthView
from graspbox.simulation.layouts import SCALES, Arrangement, Layout, SceneLayout, arrange, draws, wall_points

__all__ = ["Clutter", "PlacedObjects", "SceneConfig", "SceneSampler", "Scenes", "render_crops"]

#: Least and greatest number of objects of a scene of several: all stages of clearing it.
COUNTS: dict[Layout, tuple[int, int]] = {"packed": (1, 6), "pile": (1, 6), "bin": (1, 8)}
#: Ranges of the sides of a bin's floor along x and y, and of the height of its walls, metres.
BINS = ((0.2, 0.3), (0.2, 0.3), (0.06, 0.12))
#: Meshes that a sampler keeps ready to render; about 1 MB each.
_MESHES = 512
#: Scenes of several objects from which a completion learns, each rendered again from other cameras: settling one takes
#: longer than a training step.
_CLUTTERED = 2048
#: Distances of real cameras from the middle of the objects, metres, half of the width that their images show there, and
#: their least angle above the horizon, radians.
REAL_DISTANCE, REAL_HALF_WIDTH, REAL_ELEVATION = (0.35, 1.5), (0.2, 0.35), 0.35
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
    real : float
        Share of the scenes that are seen as by a real camera: from `REAL_DISTANCE` and lower down, with noise that
        neighbours share and holes, and with a crop around one thing, as `graspbox.perception.captured` makes it.
    """

    image_size: int = 128
    fov: tuple[float, float] = (0.45, 0.65)
    distance: tuple[float, float] = (0.45, 0.75)
    elevation: float = 0.45
    shift: float = 0.04
    noise: DepthNoise = field(default_factory=DepthNoise)
    crop: CropConfig = field(default_factory=CropConfig)
    real: float = 0.0

    def as_real(self, rng: np.random.Generator) -> "SceneConfig":
        """Draw lens, distances and noise of a real camera."""
        noise = replace(
            self.noise,
            correlated_growth=float(rng.uniform(0.0, 0.004)),
            correlation=float(rng.uniform(0.01, 0.06)),
            holes=float(rng.uniform(0.0, 0.25)),
            grazing_angle=float(rng.uniform(0.9, self.noise.grazing_angle)),
            edge_dropout=float(rng.uniform(self.noise.edge_dropout, 1.0)),
            dropout=float(rng.uniform(0.0, 0.1)),
        )
        distance = float(rng.uniform(*REAL_DISTANCE))
        fov = 2.0 * float(np.arctan(rng.uniform(*REAL_HALF_WIDTH) / distance))
        return replace(
            self,
            fov=(fov, fov),
            distance=(0.9 * distance, 1.1 * distance),
            elevation=REAL_ELEVATION,
            noise=noise,
        )


@dataclass(frozen=True, eq=False)
class PlacedObjects:
    """k objects of a scene, with poses (k, 4, 4), and w walls around them, metres: a `graspbox.meshes.Surroundings`."""

    meshes: tuple[Mesh, ...]
    world_from_objects: NDArray[np.float64]
    world_from_walls: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    wall_half_extents: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, placed: Arrangement) -> "PlacedObjects":
        """Take the objects and walls of an arrangement."""
        return cls(placed.meshes, placed.world_from_objects, placed.world_from_walls, placed.wall_half_extents)

    @property
    def middle(self) -> NDArray[np.float64]:
        """Middle of the bounds of all objects, (3,), metres."""
        corners = [pose[:3, :3] @ mesh.vertices.T + pose[:3, 3:] for mesh, pose in self]
        points = np.concatenate(corners, axis=1)
        return np.asarray((points.min(axis=1) + points.max(axis=1)) / 2)

    @property
    def obstacles(self) -> NDArray[np.float64]:
        """Points of the walls (k, 3), metres; grasps avoid them: see `graspbox.simulation.layouts.wall_points`."""
        return wall_points(self.world_from_walls, self.wall_half_extents)

    def __iter__(self) -> Any:
        """Pair every object with its pose."""
        return iter(zip(self.meshes, self.world_from_objects, strict=True))

    def render(self, config: SceneConfig, seed: Sequence[int], count: int) -> Crops:
        """Render the scene with noisy cameras: see `render_crops`."""
        mesh, pose = self.meshes[0], self.world_from_objects[0]
        if len(self.meshes) == 1 and not len(self.wall_half_extents):
            return render_crops(mesh, pose, config, seed, count)
        return render_crops(mesh, pose, config, seed, count, neighbours=self.others(), target=self.middle)

    def occupancy(self, crops: Crops, config: CropConfig) -> NDArray[np.uint8]:
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


class Clutter(NamedTuple):
    """Several objects at rest, with the index of each in the set, and its scale."""

    objects: tuple[int, ...]
    scales: tuple[float, ...]
    arrangement: Arrangement


@dataclass(frozen=True, eq=False)
class Scenes:
    """n views of scenes at rest, in their crop frames; `scene_of` (n,) names the scene of each, ascending."""

    placed: tuple[PlacedObjects, ...]
    scene_of: NDArray[np.int64]
    crops: Crops

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.scene_of)

    def occupancies(self, config: CropConfig) -> NDArray[np.uint8]:
        """Return the ground-truth occupancy of each crop, (n, N, N, N) uint8: see `PlacedObjects.occupancy`."""
        shown = (self.crops.rows(self.scene_of == scene) for scene in range(len(self.placed)))
        return np.concatenate(
            [placed.occupancy(crops, config) for placed, crops in zip(self.placed, shown, strict=True)]
        )


def render_crops(
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
    rng = np.random.default_rng(list(seed))
    real = config.real > 0.0 and bool(rng.random() < config.real)
    if real:
        config = config.as_real(rng)
    fov = float(rng.uniform(*config.fov))
    plan = ViewPlan(
        "random",
        axis=(0.0, 0.0, 1.0),
        cap=float(np.pi / 2 - config.elevation),
        distance=config.distance,
        shift=config.shift,
    )
    first, noise = rng.integers(2**62, size=2).tolist()
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
    if not real:
        return crop(depth, seen.intrinsics, seen.world_from_camera, config=config.crop)
    images = zip(depth, seen.world_from_camera, strict=True)
    return Crops.joined(
        [crop_of_a_thing(DepthView(image, seen.intrinsics, pose), config.crop, rng) for image, pose in images]
    )


class SceneSampler:
    """Samples scenes of a set of objects, which may not be empty; the seed determines all of them.

    Scenes have the layouts in turn: ``single``, or those of `graspbox.simulation.layouts`. `physics` is for trials.
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
        def resting(index: int) -> tuple[Mesh, NDArray[np.float64], NDArray[np.float64]] | None:
            """Return an object, its resting poses (k, 4, 4) and their probabilities; None if it has none."""
            mesh = objects[index].load()
            try:
                poses, probabilities = mesh.resting_poses()
            except ConfigError as error:
                _LOG.warning("object %r is left out, since it has no resting pose: %s", mesh.name, error)
                return None
            return mesh, poses, probabilities / probabilities.sum()

        @lru_cache(_CLUTTERED)
        def clutter(number: int, layout: Layout) -> PlacedObjects:
            rng = np.random.default_rng([self.seed, 1, number])
            for _ in range(_TRIES):
                try:
                    return PlacedObjects.of(self.sample_clutter(rng, layout).arrangement)
                except (MeshError, SimulationError):
                    continue
            raise ConfigError(f"{_TRIES} scenes of {self.objects.name!r} do not come to rest; choose other objects")

        self._resting, self._clutter = resting, clutter

    def sample_object(self, rng: np.random.Generator) -> tuple[int, Mesh, NDArray[np.float64]]:
        """Sample an object, by its index, and its resting pose ``world_from_object`` (4, 4).

        Objects without a resting pose are logged and skipped; raises ConfigError after too many in a row.
        """
        for _ in range(_TRIES):
            index = int(rng.integers(len(self.objects)))
            if (resting := self._resting(index)) is not None:
                mesh, poses, probabilities = resting
                return index, mesh, poses[int(rng.choice(len(poses), p=probabilities))]
        raise ConfigError(f"{_TRIES} objects of {self.objects.name!r} have no resting pose; choose other objects")

    def sample_clutter(self, rng: np.random.Generator, layout: Layout, hand: HandLike = "reflex") -> Clutter:
        """Sample a scene of several objects; the hand stays out of the way.

        Raises MeshError or SimulationError if an object cannot be simulated, or none stays.
        """
        least, most = COUNTS[layout]
        count = int(rng.integers(least, most + 1))
        number = draws(layout, count)
        drawn = [self.sample_object(rng)[:2] for _ in range(number)]
        scales = rng.uniform(*SCALES[layout], size=number).round(6).tolist()
        inside = [float(rng.uniform(*sides)) for sides in BINS]
        meshes = [mesh.scaled(scale, cache_folder()) for (_, mesh), scale in zip(drawn, scales, strict=True)]
        placed = arrange(meshes, layout, most=count, seed=int(rng.integers(2**62)), inside=inside, hand=hand)
        if not len(placed):
            raise SimulationError("no object came to rest in the workspace; choose smaller objects")
        return Clutter(tuple(drawn[i][0] for i in placed.objects), tuple(scales[i] for i in placed.objects), placed)

    def sample(self, number: int, scenes: int, views: int) -> Scenes:
        """Sample scenes at rest, rendered from `views` cameras; views without a visible object are left out."""
        rng = np.random.default_rng([self.seed, number])
        placed, crops = [], []
        for i in range(scenes):
            layout = self.layouts[(number * scenes + i) % len(self.layouts)]
            if layout == "single":
                _, mesh, pose = self.sample_object(rng)
                placed.append(PlacedObjects((mesh,), pose[None]))
            else:
                placed.append(self._clutter(int(rng.integers(_CLUTTERED)), layout))
            crops.append(placed[-1].render(self.config, [self.seed, number, i + 1], views))
        joined = Crops.joined(crops)
        scene_of = np.repeat(np.arange(scenes), views)[joined.found]
        return Scenes(tuple(placed), scene_of, joined.rows(joined.found))
