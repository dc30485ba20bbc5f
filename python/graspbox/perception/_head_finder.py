"""Grasps that one network predicts, without proposals or scorer."""

import numpy as np

from graspbox.perception.crops import Crops
from graspbox.perception.finder import Clock, Finder, Head, Ranked, observed_only, volume_of
from graspbox.perception.hand_grids import HandGrid

__all__ = ["HeadFinder"]

#: Candidates of a head that the collision filter goes through.
_FILTERED = 1024


class HeadFinder(Finder):
    """Finds grasps in depth images by a head alone.

    The grasps that it finds are the head's, best first, without those that the filter leaves out; their completed
    occupancy is the observed surface, and their `FoundGrasp.seconds` are those of ``crop``, ``head`` and ``filter``.

    Parameters
    ----------
    grid : HandGrid
        The hand, with the settings of the crop.
    net : Head
        A trained head (`graspbox.models.head.training.load_head`), or a published one.
    filtered : bool
        Take the best candidate with which the open hand touches neither the visible surface of the object nor the
        table, if there is one; by default the best of all.
    """

    def __init__(self, grid: HandGrid, net: Head, *, filtered: bool = False) -> None:
        super().__init__(grid.crop, grid.num_threads)
        self._grid, self._net, self._filtered = grid, net, filtered

    def rank(self, crops: Crops, seed: int, clock: Clock) -> Ranked:
        """Score grasps: see `Finder.rank`."""
        del seed
        found = self._net.candidates(crops.channels[0], _FILTERED if self._filtered else 1)
        clock.lap("head")
        volume = volume_of(crops, observed_only)
        ranked = Ranked(volume, found.poses, self._grid.preshapes[found.preshape], found.scores)
        if self._filtered:
            free, _ = self._grid.meets(volume[0], ranked.poses, ranked.preshapes)
            if free.any():
                ranked = ranked.kept(np.flatnonzero(free))
        clock.lap("filter")
        return ranked
