"""Settings of heads; without torch."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from graspbox.errors import ConfigError
from graspbox.perception.anchors import AnchorConfig

__all__ = ["HeadConfig", "Kind", "check_anchor"]

Kind = Literal["anchor", "set", "regressor", "constant"]


@dataclass(frozen=True)
class HeadConfig:
    """A head.

    Attributes
    ----------
    kind : {"anchor", "set", "regressor", "constant"}
        See the table of `graspbox.perception.heads`.
    width : int
        Channels of the trunk at half the crop's resolution.
    features : int
        Channels that the head ``anchor`` samples around each grasp point.
    hidden : int
        Units of its two layers.
    anchors : AnchorConfig
        The anchors of the head of that kind.
    secure : float
        Weight of the probability that a grasp is secure, beside that of success, in the choice of an anchor.
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
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}; give 1 or more")
        if not self.secure >= 0.0:
            raise ConfigError(f"secure is {self.secure}; give 0 or more")


def check_anchor(head: HeadConfig) -> None:
    """Refuse a head that cannot be published.

    Raises
    ------
    ConfigError
        If it is of another kind than ``anchor``.
    """
    if head.kind != "anchor":
        raise ConfigError(f"head.kind is {head.kind!r}; heads of the kind 'anchor' alone are published")
