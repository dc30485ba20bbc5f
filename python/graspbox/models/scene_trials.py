"""Scenes for grasp trials: objects at rest, rendered once by a noisy camera, and their simulation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.hands import Hand
from graspbox.layouts import Layout
from graspbox.models.cluttered import write_scene
from graspbox.models.scenes import PlacedObjects, SceneSampler
from graspbox.object_sets import ObjectSpec
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.simulation import Scene

__all__ = ["RenderedScene", "render_scene", "source_of"]


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """One scene.

    Attributes
    ----------
    source : str
        Object set that holds the object alone, or the text of a scene of several (`graspbox.models.cluttered`).
    objects : PlacedObjects
        The objects.
    world_from_object : (4, 4) float64
        Resting pose of the object, or of the one that reaches highest, metres.
    scene : Scene or None
        Its simulation; None if the object does not come to rest, or is too large for the hand.
    crops : Crops or None
        The one crop; None without a simulation, or if the camera does not find an object.
    crop : CropConfig
        The crop's settings.
    """

    source: str
    objects: PlacedObjects
    world_from_object: NDArray[np.float64]
    scene: Scene | None
    crops: Crops | None
    crop: CropConfig

    def true_occupancy(self, channels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the ground-truth occupancy of the crop, (1, N, N, N) uint8; ignores the channels."""
        del channels
        if self.crops is None:
            raise ConfigError("the scene has no crop; the camera does not find its object")
        return self.objects.solid(self.crops, self.crop)


def render_scene(sampler: SceneSampler, number: int, rng: np.random.Generator, hand: Hand) -> RenderedScene:
    """Sample a scene, simulate it with a hand and render it; the camera follows from the sampler's seed and number."""
    layout = sampler.layouts[number % len(sampler.layouts)]
    if layout != "single":
        return _render_clutter(sampler, number, rng, hand, layout)
    index, mesh, start = sampler.rest(rng)
    source, crop = source_of(sampler.objects[index]), sampler.config.crop
    try:
        scene = Scene(mesh, hand=hand, world_from_object=start, physics=sampler.physics)
    except (MeshError, SimulationError):
        return RenderedScene(source, PlacedObjects((mesh,), start[None]), start, None, None, crop)
    at_rest = scene.world_from_object
    placed = PlacedObjects((mesh,), at_rest[None])
    crops = placed.look(sampler.config, [sampler.seed, number], 1)
    return RenderedScene(source, placed, at_rest, scene, crops if crops.found[0] else None, crop)


def _render_clutter(
    sampler: SceneSampler, number: int, rng: np.random.Generator, hand: Hand, layout: Layout
) -> RenderedScene:
    """Sample, simulate and render a scene of several objects."""
    crop = sampler.config.crop
    try:
        heap = sampler.heap(rng, layout, hand)
        scene = Scene.of(heap.arrangement, hand=hand, physics=sampler.physics)
    except (MeshError, SimulationError):
        return RenderedScene("[]", PlacedObjects((), np.zeros((0, 4, 4))), np.eye(4), None, None, crop)
    placed = PlacedObjects.of(heap.arrangement)
    source = write_scene(placed, [source_of(sampler.objects[index]) for index in heap.objects], heap.scales)
    crops = placed.look(sampler.config, [sampler.seed, number], 1)
    return RenderedScene(source, placed, scene.world_from_object, scene, crops if crops.found[0] else None, crop)


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
