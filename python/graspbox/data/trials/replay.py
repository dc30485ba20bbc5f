"""The scene of a row, to try grasps in it again."""

from typing import TYPE_CHECKING

from graspbox._core import Hand
from graspbox.configs import PhysicsConfig
from graspbox.data.trials.images import arrangement_of
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
        One row of trials from `graspbox.data.trials.load` (``table.slice(i, 1)``).
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
        raise ConfigError(f"row has {len(row)} rows; pass one: table.slice(i, 1)")
    name, layout = row["hand"].to_pylist()[0], row["layout"].to_pylist()[0]
    if hand is None and name not in Hand.names():
        raise ConfigError(f"the row was made with the hand {name!r}, which is not shipped; pass its files as hand")
    arrangement, chosen = arrangement_of(row), name if hand is None else hand
    if layout == "single":
        rest = arrangement.world_from_objects[0]
        return Scene(arrangement.meshes[0], hand=chosen, world_from_object=rest, physics=physics)
    return Scene.of(arrangement, target=0, hand=chosen, physics=physics)
