"""Settings of perception that follow from a hand: its grid, its proposals and its anchors.

The default lengths suit the ReFlex. For another hand they scale with the reach of its fingers, down to the resolution
of a crop; a hand whose open fingers already point forward needs all the room between them.
"""

from dataclasses import dataclass, replace

import numpy as np

from graspbox._core import Hand
from graspbox.hands import HandLike, corners_of, load_hand, reach_of
from graspbox.perception.anchors import AnchorConfig
from graspbox.perception.configs import HandGridConfig, ProposalConfig

__all__ = ["HandSettings", "seeing_both_sides", "settings_of"]

#: Reach of the ReFlex, whose lengths the default settings have, metres.
_USUAL = 0.0896
#: Open fingers that extend at least this share of the reach point forward: an object passes between them.
_FORWARD = 0.5
#: Least size of cells beside the usual ones: those of a crop are hardly finer.
_FINEST = 0.6
#: Radius within which proposals see both sides of an object: this share of the hand's widest opening, at most so much,
#: metres.
_EXTENT, _WIDEST_EXTENT = 0.9, 0.07
#: Grasp point of the anchors, and least height of the hand over the table, as shares of the reach.
_POINT, _LOWEST = 0.89, 0.39


@dataclass(frozen=True)
class HandSettings:
    """Settings for one hand: its grid of cells, how geometry proposes its grasps, and the anchors of its head."""

    grid: HandGridConfig
    proposals: ProposalConfig
    anchors: AnchorConfig


def settings_of(
    hand: HandLike,
    proposals: ProposalConfig = ProposalConfig(),  # noqa: B008 (frozen)
    *,
    shape: tuple[int, int, int] | None = None,
) -> HandSettings:
    """Return settings for a hand.

    Parameters
    ----------
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    proposals : ProposalConfig
        Proposals for the ReFlex; their lengths are fitted to the hand.
    shape : tuple of int, optional
        Shape of the grid, for networks of several hands; by default that which the hand needs.

    Raises
    ------
    ConfigError, HandError
        As `graspbox.load_hand`.
    """
    loaded = load_hand(hand)
    preshapes = sorted(set(loaded.preshapes.values()))
    reach = max(reach_of(loaded, preshape) for preshape in preshapes)
    ahead = min(float(corners_of(loaded, loaded.open(preshape))[:, 2].max()) for preshape in preshapes)
    size = round(reach / _USUAL, 2)
    point = round(_POINT * reach, 3)
    anchors = replace(AnchorConfig(), reach=point, lowest=round(max(ahead, _LOWEST * reach) - point, 3))
    usual = HandGridConfig()
    grid = replace(usual, cell=round(min(1.0, max(_FINEST, size)) * usual.cell, 4))
    if shape is not None:
        grid = replace(usual, cell=_FINEST * usual.cell, shape=shape)
    if ahead >= _FORWARD * reach:
        grid = replace(grid, clearance=0.0)
    standoffs = tuple(round(size * standoff, 4) for standoff in proposals.standoffs)
    return HandSettings(
        grid, replace(proposals, standoffs=standoffs, radius=round(size * proposals.radius, 4)), anchors
    )


def seeing_both_sides(proposals: ProposalConfig, hand: Hand) -> ProposalConfig:
    """Return proposals that measure the extent of an object as far around a point as the hand opens.

    They close across the shorter side of an object nearly as wide as the opening, where others close anywhere; fewer of
    them suit an object that is too wide for the hand. A head's grasps make up for these.
    """
    if hand.widest == np.inf:
        return proposals
    return replace(proposals, radius=max(proposals.radius, round(min(_EXTENT * hand.widest, _WIDEST_EXTENT), 4)))
