"""One decision by the planner, on the surface of what a camera sees or of what completion makes of it."""

import time

import numpy as np
from numpy.typing import NDArray

from graspbox import planning
from graspbox._core import Hand
from graspbox.errors import MeshError, PlanError
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Complete, Finder, FoundGrasp, Score, observed_only
from graspbox.perception.surfaces import surface_mesh

__all__ = ["PlannedFinder"]


class PlannedFinder(Finder):
    """Finds grasps in depth images as the planner does in meshes, ranked by geometry alone.

    It stands where a `graspbox.perception.finder.GraspFinder` does.

    Parameters
    ----------
    hand : Hand
        The hand.
    complete : callable
        Tells the occupancy of crops; `observed_only` plans on what is seen.
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
        # Later a plan fails only by what is seen.
        planning.plan(mesh, hand=hand, world_from_object=np.eye(4))

    def decide(
        self, crops: Crops, *, seed: int = 0, complete: Complete | None = None, score: Score | None = None
    ) -> FoundGrasp | None:
        """Find the grasp to try; arguments and errors as for `Finder.find`, of which `score` changes nothing.

        Returns
        -------
        FoundGrasp or None
            Its grasps are the planner's feasible ones, best first, with the planner's scores; its seconds are those of
            ``crop``, ``complete`` and ``propose``. None where no object is seen, or the planner finds no grasp.
        """
        del score
        if not crops.found[0]:
            return None
        times = [time.perf_counter()]
        occupancy = (complete or self._complete)(crops.channels)[0]
        times.append(time.perf_counter())
        plan = self._plan(occupancy, seed)
        times.append(time.perf_counter())
        if plan is None or not len(plan):
            return None
        return FoundGrasp(
            world_from_hand=crops.world_from_crop[0] @ plan.poses[0],
            preshape=float(plan.preshape[0]),
            score=float(plan.score[0]),
            world_from_crop=crops.world_from_crop[0],
            object=crops.object[0],
            volume=np.concatenate([occupancy[None], crops.channels[0, :2]]),
            poses=plan.poses,
            preshapes=plan.preshape,
            scores=plan.score,
            seconds=dict(zip(("complete", "propose"), np.diff(times).tolist(), strict=True)),
        )

    def _plan(self, occupancy: NDArray[np.uint8], seed: int) -> planning.Plan | None:
        """Plan on the surface of a volume, in the crop frame."""
        mesh = surface_mesh(occupancy, self._crop)
        if mesh is None:
            return None
        try:
            found = planning.plan(mesh, hand=self._hand, seed=seed % 2**32, world_from_object=np.eye(4))
        except (MeshError, PlanError):
            # What is seen of the object is too small or too flat to plan for.
            return None
        return found.best()
