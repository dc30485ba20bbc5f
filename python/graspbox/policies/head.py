"""Grasps that one network predicts from one depth image."""

from functools import partial
from pathlib import Path

from graspbox._common.made_once import MadeOnce
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.perception import HeadFinder
from graspbox.perception.anchors import Anchors
from graspbox.perception.configs import DepthNoise
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies._observer import Observer
from graspbox.policies.depth import DepthPolicy
from graspbox.policies.published.configs import HeadPolicyConfig
from graspbox.policies.published.folders import load
from graspbox.policies.published.runtimes import AnchorHead, onnx_network

__all__ = ["HeadGrasp"]


class HeadGrasp(DepthPolicy):
    """Grasps of one network: crop and head (`graspbox.learn.models.head.network`), and a collision filter.

    Parameters
    ----------
    folder : Path
        The folder of a published head, which onnxruntime runs (`graspbox.policies.published`).
    filtered : bool, optional
        Take its best grasp that does not collide with the visible surface, instead of its best; by default as in the
        folder.
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

    #: The class of its ``config.json``, `graspbox.policies.published.registry`.
    config_class = HeadPolicyConfig

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
        published = load(folder, HeadPolicyConfig)
        chosen = published.filtered if filtered is None else filtered
        super().__init__(observer, MadeOnce(partial(_published, folder, published, chosen, num_threads)))
        self._describe(folder, published)


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
