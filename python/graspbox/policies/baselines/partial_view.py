"""Baselines of one depth image: the planner on a partial view, and proposals."""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.perception import PlannedFinder
from graspbox.perception.configs import EVERYTHING, CropConfig, DepthNoise
from graspbox.perception.finder import GraspFinder, observed_only
from graspbox.perception.hand_grids import HAND_CHANNELS, HandGrid
from graspbox.policies._observer import Observer
from graspbox.policies.depth import DepthPolicy
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.folders import read_depth_policy
from graspbox.policies.published.runtimes import load_parts

__all__ = ["BestProposal", "PartialViewPlanner"]

#: Gain of a grasp from straight above over one from the side.
_FROM_ABOVE = 0.1


class PartialViewPlanner(DepthPolicy):
    """Grasps at the planner's first-ranked pose for the visible surface, or for the completed object.

    Parameters
    ----------
    folder : Path, optional
        A policy's folder, whose completion predicts the object's occupancy; by default only the visible surface is
        used.
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
        self._describe(folder, published)
        self.name = "completed_planner"


def _completing(folder: Path, published: DepthPolicyConfig, hand: Hand) -> PlannedFinder:
    """Make a finder that plans on the shape which the completion of a published policy predicts."""
    grid = HandGrid(hand, published.settings_for(hand)[0], crop=published.crop)
    return PlannedFinder(hand, load_parts(folder, published, grid).complete, published.crop)


class BestProposal(DepthPolicy):
    """Grasps where the fingers close around most of what is or may be there; without mesh, completion or network.

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
    """Score grasps, as `graspbox.perception.scoring.Score`: see `BestProposal`."""
    near = grid.crops(volume[None], np.zeros(len(poses), dtype=np.int64), poses) / 255.0
    surface, unseen = (near[:, HAND_CHANNELS.index(name)] for name in ("surface", "unseen"))
    swept = grid.swept[grid.nearest(preshapes)]
    between, reached = (swept > 0) & (swept < 255), swept == 255
    filled = _mean(np.maximum(surface, unseen), between) - _mean(unseen, reached)
    return np.asarray(filled - _FROM_ABOVE * poses[:, 2, 2])


def _mean(values: NDArray[np.float64], cells: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Average values (m, X, Y, Z) over cells of each grasp; 0 without cells."""
    axes = (1, 2, 3)
    return np.asarray((values * cells).sum(axis=axes) / np.maximum(cells.sum(axis=axes), 1))
