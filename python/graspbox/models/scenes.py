"""Training scenes rendered on demand: objects at rest, rendered by noisy depth cameras from any side.

The seed, the number and the settings determine a scene. Nothing is stored, and a resumed training gets the same
scenes as an uninterrupted one.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._core import Mesh
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.crops import Crops, add_depth_noise, crop, solid_occupancy
from graspbox.views import ViewPlan, views

__all__ = ["SceneConfig", "SceneSampler", "Scenes", "look"]

#: Meshes that a sampler keeps ready to render; about 1 MB each.
_MESHES = 512
#: Objects sampled until one has a resting pose.
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
class Scenes:
    """n views of objects at rest, in their crop frames.

    Attributes
    ----------
    meshes : tuple of Mesh
        The objects.
    mesh_of : (n,) int64
        The mesh that each view shows.
    world_from_object : (n, 4, 4) float64
        Resting pose, metres.
    crops : Crops
        Crops from the noisy camera.
    """

    meshes: tuple[Mesh, ...]
    mesh_of: NDArray[np.int64]
    world_from_object: NDArray[np.float64]
    crops: Crops

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.mesh_of)

    def solids(self, config: CropConfig) -> NDArray[np.uint8]:
        """Return the ground-truth occupancy of each crop, (n, N, N, N) uint8; see `solid_occupancy`."""
        poses = np.linalg.inv(self.crops.world_from_crop) @ self.world_from_object
        return solid_occupancy(self.meshes, self.mesh_of.tolist(), poses, config=config)


def look(
    mesh: Mesh, world_from_object: NDArray[np.float64], config: SceneConfig, seed: Sequence[int], count: int
) -> Crops:
    """Render an object with `count` noisy cameras; `seed` determines their poses and noise."""
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

    Raises
    ------
    ConfigError
        If the set is empty.
    """

    def __init__(self, objects: object_sets.ObjectSet, config: SceneConfig, seed: int) -> None:
        if not len(objects):
            raise ConfigError(f"the object set {objects.name!r} is empty; name objects to learn from")
        self.objects, self.config, self.seed = objects, config, seed

        @lru_cache(_MESHES)
        def resting(index: int) -> Resting | None:
            mesh = objects[index].load()
            try:
                poses, probabilities = mesh.resting_poses()
            except ConfigError as error:
                _LOG.warning("object %r is left out, since it has no resting pose: %s", mesh.name, error)
                return None
            return Resting(mesh, poses, probabilities / probabilities.sum())

        self._resting = resting

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

    def sample(self, number: int, objects: int, views: int) -> Scenes:
        """Sample scene `number`: `objects` objects, each at rest in one pose and rendered from `views` cameras.

        Views without a visible object are left out.
        """
        rng = np.random.default_rng([self.seed, number])
        meshes, poses, found = [], [], []
        for _ in range(objects):
            _, mesh, pose = self.rest(rng)
            meshes.append(mesh)
            poses.append(pose)
            found.append(look(mesh, pose, self.config, [self.seed, number, len(meshes)], views))
        kept = np.concatenate([one.found for one in found])
        crops = Crops(
            *(np.concatenate([getattr(one, name) for one in found])[kept] for name in Crops.__dataclass_fields__)
        )
        of = np.repeat(np.arange(objects), views)[kept]
        return Scenes(tuple(meshes), of, np.stack(poses)[of], crops)
