"""Configuration of heads; without torch."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from graspbox._common.arguments import check_range
from graspbox.errors import ConfigError
from graspbox.perception.anchors import AnchorConfig

__all__ = ["HeadConfig", "Kind", "check_anchor"]

Kind = Literal["anchor", "set", "regressor", "constant"]


@dataclass(frozen=True)
class HeadConfig:
    """Configuration of a head.

    Attributes
    ----------
    kind : {"anchor", "set", "regressor", "constant"}
        See the table of `graspbox.models.head.heads`.
    width : int
        Channels of the trunk at half the crop's resolution.
    features : int
        Channels that the head ``anchor`` samples around each grasp point.
    hidden : int
        Units of the two hidden layers of ``anchor``.
    anchors : AnchorConfig
        Anchor grid of ``anchor``.
    secure : float
        Weight of the probability of a secure grasp relative to that of success when an anchor is chosen.
    """

    kind: Kind = "anchor"
    width: int = 32
    features: int = 16
    hidden: int = 64
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    secure: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ConfigError(f"there is no head {self.kind!r}; choose from {', '.join(get_args(Kind))}")
        for name in ("width", "features", "hidden"):
            check_range(self, name, 1, 4096)
        check_range(self, "secure", 0.0, 1000.0)


def check_anchor(head: HeadConfig) -> None:
    """Refuse a kind of head that cannot be published.

    Raises
    ------
    ConfigError
        If its kind is not ``anchor``.
    """
    if head.kind != "anchor":
        raise ConfigError(f"head.kind is {head.kind!r}; heads of the kind 'anchor' alone are published")
