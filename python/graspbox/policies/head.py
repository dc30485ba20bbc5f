"""Grasps that one network predicts from one depth image."""

from functools import partial
from pathlib import Path

from graspbox._common.made_once import MadeOnce
from graspbox._core import Hand
from graspbox.artifacts.configs import HeadPolicyConfig
from graspbox.artifacts.folders import hand_of, load
from graspbox.artifacts.runtimes import AnchorHead, onnx_network
from graspbox.errors import ConfigError
from graspbox.perception import HeadFinder
from graspbox.perception.anchors import Anchors
from graspbox.perception.configs import DepthNoise
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies._observer import Observer
from graspbox.policies.depth import DepthPolicy

__all__ = ["HEAD", "HeadGrasp"]

#: File of a folder in which a head was trained; a published one has ``config.json`` instead.
HEAD = "head.json"


class HeadGrasp(DepthPolicy):
    """Grasps of one network: crop and head (`graspbox.models.head.heads`), and a collision filter.

    Parameters
    ----------
    folder : Path
        A published head, which onnxruntime runs (`graspbox.artifacts`); or one that
        `graspbox.models.head.training.train_head` trained, which torch runs.
    filtered : bool, optional
        Take its best grasp that does not collide with the visible surface, instead of its best. By default as the
        published folder asks for it; else not.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    num_threads : int, optional
        Threads of a decision; by default one per core.

    Raises
    ------
    ConfigError
        If the folder is wrong, or lacks a file.
    """

    name = "head"

    def __init__(
        self,
        folder: Path,
        *,
        filtered: bool | None = None,
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
    ) -> None:
        folder = Path(folder)
        observer = partial(Observer, noise=noise)
        if (folder / HEAD).is_file():
            super().__init__(observer, partial(_trained, folder, bool(filtered), num_threads))
            return
        published = load(folder, HeadPolicyConfig)
        chosen = published.filtered if filtered is None else filtered
        super().__init__(observer, MadeOnce(partial(_published, folder, published, chosen, num_threads)))
        self.name, self.learned_from = published.name, published.learned_from
        self.settings = {**self.settings, "hand": hand_of(folder, published)}


def _trained(folder: Path, filtered: bool, num_threads: int | None, hand: Hand) -> HeadFinder:
    """Load a head that was not published, which needs torch."""
    from graspbox.models.head.training import load_head

    grid = HandGrid(hand, num_threads=num_threads)
    return HeadFinder(grid, load_head(folder, len(grid.preshapes), grid.crop), filtered=filtered)


def _published(
    folder: Path, published: HeadPolicyConfig, filtered: bool, num_threads: int | None, hand: Hand
) -> HeadFinder:
    """Load a published head."""
    if hand.name != published.hand:
        raise ConfigError(
            f"the policy {published.name!r} was trained for the hand {published.hand!r}, not {hand.name!r}"
        )
    grid = HandGrid(hand, crop=published.crop, num_threads=num_threads)
    if (count := len(grid.preshapes)) != published.preshapes:
        raise ConfigError(f"the policy {published.name!r} knows {published.preshapes} preshapes; its hand has {count}")
    anchors = Anchors(published.preshapes, published.head.anchors)
    return HeadFinder(grid, AnchorHead(onnx_network(folder / "head.onnx", num_threads), anchors), filtered=filtered)
