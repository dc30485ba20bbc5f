"""How the objects of a scene come to rest: only the target, or the target among others."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspbox._common.refusals import errors_of, is_refusal
from graspbox._core import Hand, Mesh
from graspbox.data.trials.settings import DatasetConfig
from graspbox.errors import GraspboxError, SimulationError
from graspbox.hands import cache_folder
from graspbox.object_sets import ObjectSpec
from graspbox.planning.plan_files import mesh_hash
from graspbox.simulation import Scene
from graspbox.simulation.layouts import SCALES, Arrangement, arrange

__all__ = ["RestingScene", "settle_among", "settle_single"]

#: Least probability of resting poses, and their greatest number: as in the environments.
_LEAST_PROBABILITY, _MOST_RESTS = 0.05, 6
#: Scenes that are made until the target stays in one.
_TRIES = 10
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class RestingScene:
    """The simulation of a target at rest, in which trials have to lift it.

    `size_factor` scales all lengths of the target. `around` has the other objects and the walls, None in the layout
    ``single``; `neighbours` describes these objects with the fields `graspbox.data.trials.schema.NEIGHBOUR`.
    """

    scene: Scene
    size_factor: float = 1.0
    around: Arrangement | None = None
    neighbours: tuple[dict[str, Any], ...] = ()

    @property
    def walls(self) -> list[dict[str, Any]]:
        """Walls, with the fields `graspbox.data.trials.schema.WALL`."""
        if self.around is None:
            return []
        walls = zip(self.around.world_from_walls, self.around.wall_half_extents, strict=True)
        return [{"world_from_wall": pose.reshape(16).tolist(), "half_extents": half.tolist()} for pose, half in walls]


def settle_single(
    name: str, mesh: Mesh, hand: Hand, config: DatasetConfig, share: float, rng: np.random.Generator
) -> RestingScene:
    """Place an object in a resting pose, with a random yaw; if it does not come to rest, in the next one.

    `share`, 0 to 1, chooses the pose by the cumulative probabilities. Without a stable pose, a `SimulationError`.
    """
    with errors_of(name):
        poses, probabilities = mesh.resting_poses()
    kept = max(1, min(_MOST_RESTS, int((probabilities >= _LEAST_PROBABILITY).sum())))
    weights = np.cumsum(probabilities[:kept]) / probabilities[:kept].sum()
    first = int(np.searchsorted(weights, share, side="right"))
    yaw = rng.uniform(0.0, 2.0 * np.pi)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    why = "it has no resting pose"
    for index in range(kept):
        start = turn @ poses[(min(first, kept - 1) + index) % kept]
        try:
            return RestingScene(Scene(mesh, hand=hand, world_from_object=start, physics=config.physics))
        except SimulationError as error:
            why = str(error)
    raise SimulationError(why)


def settle_among(
    specs: list[ObjectSpec],
    load: Callable[[ObjectSpec], Mesh],
    hand: Hand,
    config: DatasetConfig,
    rng: np.random.Generator,
) -> RestingScene:
    """Let the first object come to rest among the others, in the layout of the settings.

    Other objects that cannot be loaded are logged and left out; those that do not fit are left out. If the first object
    cannot be used, or never stays, the error is raised.
    """
    layout = config.layout
    assert layout != "single"
    objects = [(specs[0], load(specs[0])), *_loaded(specs[1:], load)]
    factors = rng.uniform(*SCALES[layout], size=len(objects)).round(6).tolist()
    meshes = [mesh.scaled(factor, cache_folder()) for (_, mesh), factor in zip(objects, factors, strict=True)]
    # In a pile the first object lies at the bottom.
    order = rng.permutation(len(meshes)).tolist()
    for _ in range(_TRIES):
        seed = int(rng.integers(2**62))
        arranged = arrange(
            [meshes[index] for index in order],
            layout,
            seed=seed,
            spread=config.spread,
            inside=config.bin_size,
            hand=hand,
            physics=config.physics,
        )
        stayed = [order[index] for index in arranged.objects]
        if 0 in stayed:
            break
    else:
        raise SimulationError(f"it stays in none of {_TRIES} scenes of the layout {layout!r}; make it smaller")
    target = stayed.index(0)
    around = arranged.without(target)
    others = [index for index in stayed if index]
    rows = [
        {
            "object": objects[index][0].name,
            "source": objects[index][0].source,
            "sha256": mesh_hash(objects[index][1]),
            "scale": objects[index][0].scale,
            "size_factor": factors[index],
            "world_from_object": pose.reshape(16).tolist(),
        }
        for index, pose in zip(others, around.world_from_objects, strict=True)
    ]
    scene = Scene.of(arranged, target=target, hand=hand, physics=config.physics)
    return RestingScene(scene, factors[0], around, tuple(rows))


def _loaded(specs: list[ObjectSpec], load: Callable[[ObjectSpec], Mesh]) -> list[tuple[ObjectSpec, Mesh]]:
    """Load objects; those that cannot be used have no scene of their own either, where the reason is kept."""
    loaded = []
    for spec in specs:
        try:
            loaded.append((spec, load(spec)))
        except GraspboxError as error:
            if not is_refusal(error):
                raise
            _LOG.warning("object %r is left out of a scene: %s", spec.name, error)
    return loaded
