"""Scenes for grasp trials: an object at rest, rendered once by a noisy camera, and its simulation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Mesh
from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.hands import Hand
from graspbox.models.scenes import SceneSampler, look
from graspbox.object_sets import ObjectSpec
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops, solid_occupancy
from graspbox.simulation import Scene

__all__ = ["RenderedScene", "render_scene", "source_of"]


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """One scene.

    Attributes
    ----------
    source : str
        Object set that holds the object alone.
    mesh : Mesh
        The object.
    world_from_object : (4, 4) float64
        Its resting pose, metres.
    scene : Scene or None
        Its simulation; None if the object does not come to rest, or is too large for the hand.
    crops : Crops or None
        The one crop around it; None without a simulation, or if the camera does not find the object.
    crop : CropConfig
        The crop's settings.
    """

    source: str
    mesh: Mesh
    world_from_object: NDArray[np.float64]
    scene: Scene | None
    crops: Crops | None
    crop: CropConfig

    def true_occupancy(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the ground-truth occupancy of the crop, (1, N, N, N) uint8; ignores the channels."""
        del channels
        if self.crops is None:
            raise ConfigError("the scene has no crop; the camera does not find its object")
        inside = np.linalg.inv(self.crops.world_from_crop) @ self.world_from_object
        return solid_occupancy([self.mesh], [0], inside, config=self.crop)


def render_scene(sampler: SceneSampler, number: int, rng: np.random.Generator, hand: Hand) -> RenderedScene:
    """Sample a scene, simulate it with a hand and render it; the camera follows from the sampler's seed and number."""
    index, mesh, start = sampler.rest(rng)
    source, crop = source_of(sampler.objects[index]), sampler.config.crop
    try:
        scene = Scene(mesh, hand=hand, world_from_object=start)
    except (MeshError, SimulationError):
        return RenderedScene(source, mesh, start, None, None, crop)
    at_rest = scene.world_from_object
    crops = look(mesh, at_rest, sampler.config, [sampler.seed, number], 1)
    return RenderedScene(source, mesh, at_rest, scene, crops if crops.found[0] else None, crop)


def source_of(spec: ObjectSpec) -> str:
    """Name an object set that holds this object alone, in the syntax of `graspbox.object_sets.load`.

    Raises
    ------
    ConfigError
        For a scaled object, which no set names.
    """
    if spec.scale != 1.0:
        raise ConfigError(f"object {spec.name!r} is scaled by {spec.scale}; collect trials on sets without a scale")
    if spec.family is not None:
        return f"procedural:{spec.family}:{spec.seed}"
    return str(spec.path)
