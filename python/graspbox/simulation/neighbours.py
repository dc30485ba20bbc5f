"""The objects beside the object of a scene."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Mesh
from graspbox.simulation import Scene


class Neighbours(NamedTuple):
    """Objects and walls: a `graspbox.meshes.Surroundings`."""

    meshes: Sequence[Mesh]
    world_from_objects: NDArray[np.float64]
    world_from_walls: NDArray[np.float64]
    wall_half_extents: NDArray[np.float64]

    @classmethod
    def of(cls, scene: Scene) -> "Neighbours":
        """Return all objects of a scene beside its object, at rest, and its walls."""
        return cls(scene.others, scene.world_from_others, scene.world_from_walls, scene.wall_half_extents)
