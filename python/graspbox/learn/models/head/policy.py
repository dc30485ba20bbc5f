"""A trained head that was not published, as a policy; torch runs it."""

from functools import partial
from pathlib import Path

from graspbox._core import Hand
from graspbox.learn.models.head.training import load_head
from graspbox.perception import HeadFinder
from graspbox.perception.configs import DepthNoise
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies import DepthPolicy, Observer

__all__ = ["TrainedHead"]


class TrainedHead(DepthPolicy):
    """Grasps of a head in the folder of its training: `graspbox.policies.HeadGrasp` before it is published.

    Parameters
    ----------
    folder : Path
        The folder that `graspbox.learn.models.head.training.train_head` wrote.
    filtered : bool
        Take its best grasp that does not collide with the visible surface, instead of its best.
    """

    name = "head"

    def __init__(self, folder: Path, *, filtered: bool = False) -> None:
        super().__init__(partial(Observer, noise=DepthNoise()), partial(_finder, Path(folder), filtered))


def _finder(folder: Path, filtered: bool, hand: Hand) -> HeadFinder:
    grid = HandGrid(hand)
    return HeadFinder(grid, load_head(folder, len(grid.preshapes), grid.crop), filtered=filtered)
