"""The scene of a row, to try grasps in it again."""

from typing import TYPE_CHECKING

import numpy as np

from graspbox._core import Hand
from graspbox.configs import PhysicsConfig
from graspbox.dataset.images import placed_objects
from graspbox.errors import ConfigError
from graspbox.hands import HandLike
from graspbox.simulation import Scene

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["scene_of"]


def scene_of(
    row: "pa.Table",
    *,
    hand: HandLike | None = None,
    physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
) -> Scene:
    """Rebuild the scene of a row: the object at rest, with its neighbours and walls.

    ``scene.simulate(pose, preshape, friction=..., mass=...)`` with the row's ``executed_object_from_hand``,
    ``preshape``, ``friction_factor`` and ``mass_factor`` repeats its trial.

    Parameters
    ----------
    row : pyarrow.Table
        One row of trials from `graspbox.dataset.load` (``table.slice(i, 1)``).
    hand : str, Hand or pair of paths, optional
        The hand; by default the shipped hand that the row names.
    physics : PhysicsConfig
        Settings of the physics engine; those of the data set are in its ``manifest.json``.

    Raises
    ------
    ConfigError
        If there is not one row, its hand is not a shipped one, or a mesh has changed.
    SimulationError
        If the object does not come to rest again.
    """
    if len(row) != 1:
        raise ConfigError(f"row has {len(row)} rows; give one: table.slice(i, 1)")
    name = row["hand"].to_pylist()[0]
    if hand is None and name not in Hand.names():
        raise ConfigError(
            f"the row was made with the hand {name!r}, which is not a shipped one; give its files as hand"
        )
    placed = placed_objects(row)
    chosen = name if hand is None else hand
    if row["layout"].to_pylist()[0] == "single":
        rest = np.asarray(placed.world_from_objects[0])
        return Scene(placed.meshes[0], hand=chosen, world_from_object=rest, physics=physics)
    return Scene.of(placed, target=0, hand=chosen, physics=physics)
