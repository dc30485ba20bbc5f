"""Baselines that see one depth image: the planner on a partial view, and the nearest known scene."""

from functools import partial
from pathlib import Path

from graspbox._core import Hand
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import hand_of, read_depth_policy
from graspbox.artifacts.runtimes import load_parts
from graspbox.models.nearest_finder import Memory, NearestFinder
from graspbox.perception import PlannedFinder
from graspbox.perception.configs import DepthNoise
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies._observer import Observer
from graspbox.policies.depth import DepthPolicy

__all__ = ["NearestGrasp", "PartialViewPlanner"]


class PartialViewPlanner(DepthPolicy):
    """Grasps at the planner's first-ranked pose for the surface that a camera sees, or for the completed object.

    Parameters
    ----------
    folder : Path, optional
        A policy's folder, whose completion predicts the object's occupancy. By default the planner has the visible
        surface alone.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "partial_view_planner"

    def __init__(self, folder: Path | None = None, *, noise: DepthNoise = DepthNoise()) -> None:  # noqa: B008 (frozen)
        observer = partial(Observer, noise=noise)
        if folder is None:
            super().__init__(observer, PlannedFinder)
            return
        published = read_depth_policy(folder)
        super().__init__(observer, partial(_completing, Path(folder), published))
        self.name, self.learned_from = "completed_planner", published.learned_from
        self.settings = {**self.settings, "hand": hand_of(folder, published)}


def _completing(folder: Path, published: DepthPolicyConfig, hand: Hand) -> PlannedFinder:
    """Make a finder that plans on the shape which the completion of a published policy predicts."""
    grid = HandGrid(hand, published.settings_for(hand)[0], crop=published.crop)
    return PlannedFinder(hand, load_parts(folder, published, grid).complete, published.crop)


class NearestGrasp(DepthPolicy):
    """Grasps as it was done with success in the known scene that looks most alike.

    Parameters
    ----------
    memory : Memory
        Known scenes: `graspbox.models.nearest_finder.remember` makes them of a data set.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "nearest"

    def __init__(self, memory: Memory, *, noise: DepthNoise = DepthNoise()) -> None:  # noqa: B008 (frozen)
        super().__init__(partial(Observer, noise=noise), lambda hand: NearestFinder(memory))
        self.learned_from = memory.learned_from
