"""Baselines that see one depth image: the planner on a partial view, proposals, and the nearest known scene."""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.artifacts.configs import DepthPolicyConfig
from graspbox.artifacts.folders import hand_of, read_depth_policy
from graspbox.artifacts.runtimes import load_parts
from graspbox.models.nearest_finder import Memory, NearestFinder
from graspbox.perception import PlannedFinder
from graspbox.perception.configs import EVERYTHING, CropConfig, DepthNoise
from graspbox.perception.finder import GraspFinder, observed_only
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid
from graspbox.policies._observer import Observer
from graspbox.policies.depth import DepthPolicy

__all__ = ["BestProposal", "NearestGrasp", "PartialViewPlanner"]

#: Gain of a grasp from straight above over one from the side.
_FROM_ABOVE = 0.1


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


class BestProposal(DepthPolicy):
    """Grasps where the fingers close around most of what is or may be there; neither mesh, completion nor network.

    Grasps are proposed on the visible surface of everything on the table (`graspbox.perception.HandGrid.propose`). The
    score of one is the share of the cells swept by its closing fingers that are surface or unseen, less the share of
    the cells of its open fingers that are unseen, and a little more from above.

    Parameters
    ----------
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    """

    name = "best_proposal"

    def __init__(self, *, noise: DepthNoise = DepthNoise()) -> None:  # noqa: B008 (frozen)
        super().__init__(partial(Observer, noise=noise), _proposing)


def _proposing(hand: Hand) -> GraspFinder:
    """Make a finder that scores proposals by geometry."""
    grid = HandGrid(hand, crop=CropConfig(gap=EVERYTHING))
    return GraspFinder(grid, observed_only, partial(_filled, grid))


def _filled(
    grid: HandGrid, volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Score grasps, as `graspbox.perception.finder.Score`: see `BestProposal`."""
    near = grid.crops(volume[None], np.zeros(len(poses), dtype=np.int64), poses) / 255.0
    surface, unseen = (near[:, HAND_CHANNELS.index(name)] for name in ("surface", "unseen"))
    swept = grid.swept[grid.nearest(preshapes)]
    between, reached = (swept > 0) & (swept < 255), swept == 255
    filled = _mean(np.maximum(surface, unseen), between) - _mean(unseen, reached)
    return np.asarray(filled - _FROM_ABOVE * poses[:, 2, 2])


def _mean(values: NDArray[np.float64], cells: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Average values (m, X, Y, Z) over cells of each grasp; 0 where it has none."""
    axes = (1, 2, 3)
    return np.asarray((values * cells).sum(axis=axes) / np.maximum(cells.sum(axis=axes), 1))


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
