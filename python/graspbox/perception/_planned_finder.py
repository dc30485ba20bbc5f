"""Grasps of the planner, on the surface that a camera sees or that a completion makes of it."""

import numpy as np

from graspbox import planning
from graspbox._core import Hand
from graspbox.errors import MeshError, PlanError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Clock, Complete, Finder, Ranked, observed_only, volume_of
from graspbox.perception.shapes import surface_mesh

__all__ = ["PlannedFinder"]


class PlannedFinder(Finder):
    """Finds grasps in depth images as the planner does in meshes, ranked by geometry alone.

    The grasps that it finds are the planner's feasible ones, best first, with the planner's scores; their
    `FoundGrasp.seconds` are those of ``crop``, ``complete`` and ``propose``.

    Parameters
    ----------
    hand : Hand
        The hand.
    complete : callable
        Predicts the occupancy of crops; `observed_only` plans on the visible surface.
    crop : CropConfig
        The crop.

    Raises
    ------
    PlanError
        If the planner does not support the hand.
    """

    def __init__(
        self,
        hand: Hand,
        complete: Complete = observed_only,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
    ) -> None:
        super().__init__(crop)
        self._hand, self._complete = hand, complete
        n = crop.resolution
        block = np.zeros((n, n, n), dtype=np.uint8)
        block[n // 2 - 4 : n // 2 + 4, n // 2 - 4 : n // 2 + 4, 3:11] = 255
        mesh = surface_mesh(block, crop)
        assert mesh is not None
        # Fails here for a hand that the planner does not support, instead of at the first image.
        planning.plan(mesh, hand=hand, world_from_object=np.eye(4))

    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked | None:
        """Score grasps: see `Finder.rank`. None where the visible surface is too small or too flat to plan for."""
        volume = volume_of(crops, self._complete)
        clock.lap("complete")
        mesh = surface_mesh(volume[0], self.crop)
        if mesh is None:
            return None
        try:
            plan = planning.plan(mesh, hand=self._hand, seed=seed % 2**32, world_from_object=np.eye(4)).best()
        except (MeshError, PlanError):
            return None
        clock.lap("propose")
        return Ranked(volume, plan.poses, plan.preshape, plan.score)
