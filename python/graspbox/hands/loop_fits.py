"""How well a mimic joint replaces a closed loop of an MJCF hand."""

from dataclasses import dataclass

__all__ = ["LoopFit"]


@dataclass(frozen=True)
class LoopFit:
    """A mimic joint in place of a closed loop.

    Attributes
    ----------
    leader : str
        The joint that it follows.
    ratio, offset : float
        Its position is `ratio` times the leader's, plus `offset`; radians or metres.
    most : float
        Greatest difference from the position in the closed loop, over the leader's range, radians or metres.
    gap : float
        Greatest distance between the two bodies where the loop was closed, over the leader's range, metres.
    """

    leader: str
    ratio: float
    offset: float
    most: float
    gap: float
