"""Baselines that see one depth image: the planner on what is seen, and the nearest known scene."""

from pathlib import Path

from graspbox.perception.configs import DepthNoise
from graspbox.perception.finder import Finder, observed_only
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.nearest_finder import Memory, NearestFinder
from graspbox.perception.planned_finder import PlannedFinder
from graspbox.perception.policy_folders import DepthPolicyConfig, read_depth_policy
from graspbox.perception.runtimes import load_parts
from graspbox.policies.depth import DepthGrasp

__all__ = ["NearestGrasp", "SeenPlanner"]


class SeenPlanner(DepthGrasp):
    """Grasps at the planner's first-ranked pose for the surface that a camera sees, or for the completed object.

    Parameters
    ----------
    folder : Path, optional
        A policy's folder, whose completion tells the object's occupancy. By default the planner has the observed
        surface alone.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "seen_planner"

    def __init__(self, folder: Path | None = None, *, noise: DepthNoise = DepthNoise()) -> None:  # noqa: B008 (frozen)
        super().__init__(folder, noise=noise)
        self.name = "seen_planner" if folder is None else "completed_planner"

    def _read(self, folder: Path | None) -> DepthPolicyConfig | None:
        return None if folder is None else read_depth_policy(Path(folder))

    def _make_finder(self) -> Finder:
        complete = observed_only
        if self._folder is not None and self._published is not None:
            grid = HandGrid(self.hand, self._published.grid, crop=self.crop)
            complete = load_parts(Path(self._folder), self._published, grid, self._backend).complete
        return PlannedFinder(self.hand, complete, self.crop)


class NearestGrasp(DepthGrasp):
    """Grasps as it was done with success in the known scene that looks most alike.

    Parameters
    ----------
    memory : Memory
        Known scenes: `graspbox.perception.nearest_finder.remember` makes them of a data set.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "nearest"

    def __init__(self, memory: Memory, *, noise: DepthNoise = DepthNoise()) -> None:  # noqa: B008 (frozen)
        super().__init__(None, noise=noise)
        self._memory, self.learned_from = memory, memory.learned_from

    def _read(self, folder: Path | None) -> None:
        """Leave everything to the memory."""
        del folder

    def _make_finder(self) -> Finder:
        return NearestFinder(self._memory, self.crop)
