"""One decision by one network: from a depth image to the grasp to try, without proposals or scorer."""

import time

import numpy as np

from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import Crops
from graspbox.perception.finder import Complete, Finder, FoundGrasp, Head, Score, observed_only
from graspbox.perception.hand_grids import HandGrid

__all__ = ["HeadFinder"]

#: Candidates of a head that the collision filter goes through.
_FILTERED = 1024


class HeadFinder(Finder):
    """Finds grasps in depth images by a head; stands where a `graspbox.perception.finder.GraspFinder` does.

    Parameters
    ----------
    grid : HandGrid
        The hand.
    net : Head
        A trained head (`graspbox.perception.head_training.load_head`), or a published one.
    crop : CropConfig
        The crop; that of `grid`.
    filtered : bool
        Take the best candidate with which the open hand touches neither what is seen of the object nor the table, if
        there is one; by default the best of all.
    """

    def __init__(
        self,
        grid: HandGrid,
        net: Head,
        *,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
        filtered: bool = False,
    ) -> None:
        super().__init__(crop)
        self._grid, self._net, self._filtered = grid, net, filtered

    def decide(
        self, crops: Crops, *, seed: int = 0, complete: Complete | None = None, score: Score | None = None
    ) -> FoundGrasp | None:
        """Find the grasp to try; arguments and errors as for `Finder.find`, of which the last three change nothing.

        Returns
        -------
        FoundGrasp or None
            Its completed occupancy is the observed surface. Its grasps are the head's, best first, without those that
            the filter leaves out, and its seconds those of ``crop``, ``head`` and ``filter``. None where no object is
            seen.
        """
        del seed, complete, score
        if not crops.found[0]:
            return None
        started = time.perf_counter()
        found = self._net.candidates(crops.channels[0], _FILTERED if self._filtered else 1)
        predicted = time.perf_counter()
        occupancy = observed_only(crops.channels)[0]
        poses, preshapes, scores = found.poses, self._grid.preshapes[found.preshape], found.scores
        if self._filtered:
            free, _ = self._grid.meets(occupancy, poses, preshapes)
            if free.any():
                poses, preshapes, scores = poses[free], preshapes[free], scores[free]
        seconds = {"head": predicted - started, "filter": time.perf_counter() - predicted}
        return FoundGrasp(
            world_from_hand=crops.world_from_crop[0] @ poses[0],
            preshape=float(preshapes[0]),
            score=float(scores[0]),
            world_from_crop=crops.world_from_crop[0],
            object=crops.object[0],
            volume=np.concatenate([occupancy[None], crops.channels[0, :2]]),
            poses=poses,
            preshapes=preshapes,
            scores=scores,
            seconds=seconds,
        )
