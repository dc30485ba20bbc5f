"""Scenes for grasp trials: objects at rest, rendered once by a noisy camera, and their simulation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.hands import Hand
from graspbox.learn.models.cluttered import write_scene
from graspbox.learn.models.scenes import PlacedObjects, SceneSampler
from graspbox.object_sets import ObjectSpec
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.simulation import Scene
from graspbox.simulation.layouts import Layout

__all__ = ["RenderedScene", "render_scene", "source_of"]


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """One scene.

    Attributes
    ----------
    source : str
        The scene, as `graspbox.learn.models.cluttered` writes it.
    world_from_object : (4, 4) float64
        Resting pose of the object, or of the one that reaches highest, metres.
    scene : Scene or None
        Its simulation; None if the object does not come to rest, or is too large for the hand.
    crops : Crops or None
        The one crop; None without a simulation, or if the camera sees no object.
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
            raise ConfigError("the scene has no crop; the camera does not see its object")
        return self.objects.occupancy(self.crops, self.crop)


def render_scene(sampler: SceneSampler, number: int, rng: np.random.Generator, hand: Hand) -> RenderedScene:
    """Sample a scene, simulate it with a hand and render it; the camera follows from the sampler's seed and number."""
    layout = sampler.layouts[number % len(sampler.layouts)]
    if layout != "single":
        return _render_clutter(sampler, number, rng, hand, layout)
    index, mesh, start = sampler.sample_object(rng)
    source = source_of(sampler.objects[index])
    try:
        scene = Scene(mesh, hand=hand, world_from_object=start, physics=sampler.physics)
    except (MeshError, SimulationError):
        return RenderedScene(source, PlacedObjects((mesh,), start[None]), start, None, None, sampler.config.crop)
    placed = PlacedObjects((mesh,), scene.world_from_object[None])
    return _rendered(sampler, number, source, placed, scene)


def _render_clutter(
    sampler: SceneSampler, number: int, rng: np.random.Generator, hand: Hand, layout: Layout
) -> RenderedScene:
    """Sample, simulate and render a scene of several objects."""
    try:
        clutter = sampler.sample_clutter(rng, layout, hand)
        scene = Scene.of(clutter.arrangement, hand=hand, physics=sampler.physics)
    except (MeshError, SimulationError):
        nothing = PlacedObjects((), np.zeros((0, 4, 4)))
        return RenderedScene("[]", nothing, np.eye(4), None, None, sampler.config.crop)
    placed = PlacedObjects.of(clutter.arrangement)
    source = write_scene(placed, [source_of(sampler.objects[index]) for index in clutter.objects], clutter.scales)
    return _rendered(sampler, number, source, placed, scene)


def _rendered(sampler: SceneSampler, number: int, source: str, placed: PlacedObjects, scene: Scene) -> RenderedScene:
    crops = placed.render(sampler.config, [sampler.seed, number], 1)
    seen = crops if crops.found[0] else None
    return RenderedScene(source, placed, scene.world_from_object, scene, seen, sampler.config.crop)


def source_of(spec: ObjectSpec) -> str:
    """Name an object set that holds only this object, by its mesh; raises ConfigError for a scaled object."""
    if spec.scale != 1.0:
        raise ConfigError(f"object {spec.name!r} is scaled by {spec.scale}; collect trials on sets without a scale")
    if spec.family is not None:
        return f"procedural:{spec.family}:{spec.seed}"
    return str(spec.path)
