"""Finders without a scorer: `HeadFinder` and `PlannedFinder`."""

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Hand
from graspbox.errors import MeshError, PlanError
from graspbox.perception.configs import CropConfig
from graspbox.perception.depth_views import Seen
from graspbox.perception.finder import Complete, Finder, Head, Proposed, Query, observed_only
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.shapes import surface_mesh

__all__ = ["HeadFinder", "PlannedFinder"]

#: Candidates of a head that the collision filter goes through.
_FILTERED = 1024


class HeadFinder(Finder):
    """Finds grasps in depth images by a head only: its grasps, best first; their occupancy is the observed surface.

    Parameters
    ----------
    grid : HandGrid
        The hand, with the settings of the crop.
    net : Head
        A trained head (`graspbox.learn.models.head.training.load_head`), or a published one.
    filtered : bool
        Take the best candidate with which the open hand touches neither the visible surface of the object nor the
        table, if there is one; by default the best of all.
    """

    def __init__(self, grid: HandGrid, net: Head, *, filtered: bool = False) -> None:
        super().__init__(grid.crop, grid.num_threads)
        self._grid, self._net, self._filtered = grid, net, filtered

    def propose(self, volume: NDArray[np.uint8], seen: Seen, query: Query) -> Proposed:
        """Predict grasps with their scores: see `Finder.propose`."""
        del query
        best = self._net.candidates(seen.crops.channels[0], _FILTERED if self._filtered else 1)
        poses, preshapes, scores = best.poses, self._grid.preshapes[best.preshape], best.scores
        if self._filtered:
            free, _ = self._grid.meets(volume[0], poses, preshapes)
            if free.any():
                poses, preshapes, scores = poses[free], preshapes[free], scores[free]
        return Proposed(poses, preshapes, scores)


class PlannedFinder(Finder):
    """Finds grasps in depth images as the planner does in meshes: its feasible grasps with its scores, best first.

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
        super().__init__(crop, complete=complete)
        self._hand = hand
        n = crop.resolution
        block = np.zeros((n, n, n), dtype=np.uint8)
        block[n // 2 - 4 : n // 2 + 4, n // 2 - 4 : n // 2 + 4, 3:11] = 255
        mesh = surface_mesh(block, crop)
        assert mesh is not None
        # Fails here for a hand that the planner does not support, instead of at the first image.
        planning.plan(mesh, hand=hand, world_from_object=np.eye(4))

    def propose(self, volume: NDArray[np.uint8], seen: Seen, query: Query) -> Proposed:
        """Plan grasps: see `Finder.propose`; none if the surface is too small or too flat to plan for."""
        del seen
        none = Proposed(np.zeros((0, 4, 4)), np.zeros(0))
        mesh = surface_mesh(volume[0], self.crop)
        if mesh is None:
            return none
        try:
            plan = planning.plan(mesh, hand=self._hand, seed=query.seed % 2**32, world_from_object=np.eye(4)).best()
        except (MeshError, PlanError):
            return none
        return Proposed(plan.poses, plan.preshape, plan.score)
