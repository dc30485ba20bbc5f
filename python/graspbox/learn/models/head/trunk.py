"""The trunk of a head: a 2-D U-Net over the crop viewed from above, whose channels are the voxels of each column."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from graspbox.errors import ConfigError

__all__ = ["Trunk", "unit"]

#: Channels of a crop that are inputs of a head: surface and unseen. The third, the table, is the same in every crop.
_SEEN = 2


def unit(before: int, after: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    """Convolution, normalization, rectified linear unit."""
    padding = 0 if size == stride else size // 2 if stride == 1 else 1
    return nn.Sequential(
        nn.Conv2d(before, after, size, stride, padding, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)
    )


class _Residual(nn.Module):  # type: ignore[misc]
    """Two convolutions with a residual connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = unit(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.norm(self.second(self.first(x))))


class Trunk(nn.Module):  # type: ignore[misc]
    """A U-Net from channels (n, 2, N, N, N) uint8 to features (n, width, N/2, N/2); N is a multiple of 8.

    Coarser levels have twice and four times `width` channels.
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
        """Return the features."""
        # The voxels of a column become channels; memory is contiguous in torch's channels-last format.
        seen = torch.cat([volumes[:, 0], volumes[:, 1]], dim=3).permute(0, 3, 1, 2).float() / 255.0
        fine = self.stem(self.columns(seen))
        middle = self.down_1(fine)
        middle = self.smooth_2(functional.relu(middle + self.up_2(self.down_2(middle))))
        features: Tensor = self.smooth_1(functional.relu(fine + self.up_1(middle)))
        return features
