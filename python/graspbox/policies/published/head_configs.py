"""Configuration of heads."""

from dataclasses import dataclass, field

from graspbox._common.arguments import check_range
from graspbox.perception.anchors import AnchorConfig

__all__ = ["HeadConfig"]


@dataclass(frozen=True)
class HeadConfig:
    """Configuration of a head.

    Attributes
    ----------
    width : int
        Channels of the trunk at half the crop's resolution.
    features : int
        Channels sampled around each grasp point.
    hidden : int
        Units of the two hidden layers.
    anchors : AnchorConfig
        Anchor grid.
    secure : float
        Weight of a secure grasp's probability against that of success when an anchor is chosen.
    """

    width: int = 32
    features: int = 16
    hidden: int = 64
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    secure: float = 0.5

    def __post_init__(self) -> None:
        for name in ("width", "features", "hidden"):
            check_range(self, name, 1, 4096)
        check_range(self, "secure", 0.0, 1000.0)
