"""What heads have in common: their settings, what they give, and their trunk."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from graspbox.errors import ConfigError
from graspbox.perception.anchors import AnchorConfig

__all__ = ["Candidates", "HeadConfig", "Kind", "Trunk", "unit"]

Kind = Literal["anchor", "set", "regressor", "constant"]
#: Channels of a crop that a head sees: surface and unseen. The third, the table, is the same in every crop.
_SEEN = 2


@dataclass(frozen=True)
class HeadConfig:
    """A head.

    Attributes
    ----------
    kind : {"anchor", "set", "regressor", "constant"}
        See the table of the module.
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


@dataclass(frozen=True, eq=False)
class Candidates:
    """k grasps of one crop, the best first.

    Attributes
    ----------
    poses : (k, 4, 4) float64
        ``crop_from_hand``, metres.
    preshape : (k,) int64
        Indices of the hand's preshapes.
    scores : (k,) float64
        The greater, the better.
    """

    poses: NDArray[np.float64]
    preshape: NDArray[np.int64]
    scores: NDArray[np.float64]


def unit(before: int, after: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    """Convolution, normalization, rectifier."""
    padding = 0 if size == stride else size // 2 if stride == 1 else 1
    return nn.Sequential(
        nn.Conv2d(before, after, size, stride, padding, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)
    )


class _Residual(nn.Module):  # type: ignore[misc]
    """Two convolutions that are added to their input."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = unit(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.norm(self.second(self.first(x))))


class Trunk(nn.Module):  # type: ignore[misc]
    """A U-Net from channels (n, 2, N, N, N) uint8 to features (n, width, N/2, N/2); N is a multiple of 8.

    Parameters
    ----------
    resolution : int
        N.
    width : int
        Channels at half the resolution; coarser levels have twice and four times as many.
    """

    def __init__(self, resolution: int, width: int) -> None:
        super().__init__()
        if resolution % 8:
            raise ConfigError(f"resolution is {resolution}; heads need a multiple of 8")
        fine, middle, coarse = width, 2 * width, 4 * width
        self.columns = unit(_SEEN * resolution, width, 1)
        self.stem = nn.Sequential(unit(width, fine, 4, 2), _Residual(fine))
        self.down_1 = nn.Sequential(unit(fine, middle, 2, 2), _Residual(middle), _Residual(middle))
        self.down_2 = nn.Sequential(unit(middle, coarse, 2, 2), _Residual(coarse), _Residual(coarse))
        self.up_2 = nn.ConvTranspose2d(coarse, middle, 2, stride=2)
        self.smooth_2 = _Residual(middle)
        self.up_1 = nn.ConvTranspose2d(middle, fine, 2, stride=2)
        self.smooth_1 = _Residual(fine)

    def forward(self, volumes: Tensor) -> Tensor:
        """Give the features."""
        # The voxels of a column become channels; they are contiguous, as torch's "channels last" wants them.
        seen = torch.cat([volumes[:, 0], volumes[:, 1]], dim=3).permute(0, 3, 1, 2).float() / 255.0
        fine = self.stem(self.columns(seen))
        middle = self.down_1(fine)
        middle = self.smooth_2(functional.relu(middle + self.up_2(self.down_2(middle))))
        found: Tensor = self.smooth_1(functional.relu(fine + self.up_1(middle)))
        return found
