"""A features extractor with a suitable network for each kind of observation.

Stable-Baselines3 has a network for uint8 images only; it flattens depth, labels, points and voxels. `Extractor` chooses
a network by the space, for each entry of a ``Dict``; pass it as
``policy_kwargs=dict(features_extractor_class=Extractor)``.

| space | interpreted as | network |
|---|---|---|
| one axis | a vector | none; the values pass through |
| (n, 3) or (H, W, 3), float, negative x allowed | points | one small network applied to every visible point, then the maximum |
| three equal sides | voxels | labels as channels, Conv3d |
| three axes, the first or the last at most 16 | an image; the channels are on that axis | Conv2d |
| four axes, the first at most 16 | voxels with channels, in a frame that is the same in every observation | Conv2d, the second axis as channels |

Images of uint8 up to 255 are colour: Stable-Baselines3 scales them to [0, 1] and puts channels first. Smaller uint8 are
labels, one-hot encoded as channels. Floats (depth, rgbd) and voxels with channels are scaled to [0, 1] by the bounds
of the space.

>>> from stable_baselines3 import PPO
>>> from graspbox.sb3 import Extractor, VecEnv
>>> env = VecEnv.make("graspbox/Grasp-v0", num_envs=2, objects="procedural:can:0", obs=("proprio", "depth"))
>>> policy = {"features_extractor_class": Extractor, "features_extractor_kwargs": {"features": 64}}
>>> model = PPO("MultiInputPolicy", env, policy_kwargs=policy, n_steps=8, batch_size=16, device="cpu").learn(16)
"""  # noqa: E501

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from graspbox.errors import ConfigError

__all__ = ["Extractor", "ImageNet", "PointNet", "VolumeNet", "VoxelNet", "network"]

#: An axis longer than this does not hold channels.
_MAX_CHANNELS = 16
#: Larger clouds are subsampled evenly, which keeps a policy fast on a CPU.
_MAX_POINTS = 1024
#: Side of the last feature map of an image and of voxels.
_MAP_2D, _MAP_3D = 4, 2


def _is_points(space: Box) -> bool:
    floats, seen = np.issubdtype(space.dtype, np.floating), len(space.shape) in (2, 3) and space.shape[-1] == 3
    return bool(floats and seen and (space.low[..., 0] < 0).all())


def _labels(space: Box) -> int | None:
    """Return the number of labels of a space; None if its values are not labels."""
    if not np.issubdtype(space.dtype, np.integer) or (space.high == 255).all():
        return None
    return int(space.high.max()) + 1


class _Unit(nn.Module):  # type: ignore[misc]
    """Channels (rows, channels, ...) of observations (rows, *shape): one-hot labels, floats in [0, 1]."""

    low: Tensor
    span: Tensor

    def __init__(self, space: Box, channel_axis: int | None) -> None:
        super().__init__()
        self.labels = _labels(space)
        self._axis = channel_axis
        self._colour = self.labels is None and np.issubdtype(space.dtype, np.integer)
        low, span = space.low.astype(np.float32), (space.high - space.low).astype(np.float32)
        if not self._colour and not (np.isfinite([low, span]).all() and (span > 0).all()):
            raise ConfigError(f"the bounds of {space} define the scaling; give finite ones, low below high")
        self.register_buffer("low", torch.as_tensor(low), persistent=False)
        self.register_buffer("span", torch.as_tensor(span), persistent=False)
        own = 1 if channel_axis is None else space.shape[channel_axis]
        self.channels = own * (self.labels or 1)

    def forward(self, observation: Tensor) -> Tensor:
        # Stable-Baselines3 has already scaled colours.
        scaled = self.labels is None and not self._colour
        found = (observation - self.low) / self.span if scaled else observation
        found = found.unsqueeze(1) if self._axis is None else found.movedim(self._axis + 1, 1)
        if self.labels is None:
            return found
        ones = nn.functional.one_hot(found.long(), self.labels).movedim(-1, 2)
        return ones.flatten(1, 2).to(observation.dtype)


def _convolutions(
    conv: type[nn.Module], before: int, sizes: Sequence[tuple[int, int]], pool: nn.Module, features: int
) -> list[nn.Module]:
    """Make strided convolutions of (channels, kernel size) with the last feature map `pool`, and a linear layer."""
    layers: list[nn.Module] = []
    for channels, size in sizes:
        layers += [conv(before, channels, size, stride=2, padding=(size - 1) // 2), nn.ReLU()]
        before = channels
    cells = pool.output_size ** (3 if conv is nn.Conv3d else 2)
    return [*layers, pool, nn.Flatten(), nn.Linear(before * cells, features), nn.ReLU()]


class ImageNet(nn.Module):  # type: ignore[misc]
    """Features of an image: four strided convolutions and a linear layer.

    Parameters
    ----------
    space : Box
        Three axes; the first or the last holds the channels.
    features : int
        Number of features.
    """

    def __init__(self, space: Box, features: int) -> None:
        super().__init__()
        axis = 0 if space.shape[0] < space.shape[2] else 2
        self.unit = _Unit(space, axis)
        sizes, pool = ((16, 5), (32, 3), (64, 3), (64, 3)), nn.AdaptiveAvgPool2d(_MAP_2D)
        self.net = nn.Sequential(*_convolutions(nn.Conv2d, self.unit.channels, sizes, pool, features))

    def forward(self, observation: Tensor) -> Tensor:
        """Features (rows, features) of images (rows, *shape)."""
        found: Tensor = self.net(self.unit(observation))
        return found


class VoxelNet(nn.Module):  # type: ignore[misc]
    """Features of a cube of voxels (N, N, N): three strided convolutions and a linear layer.

    Parameters
    ----------
    space : Box
        Three axes of the same length.
    features : int
        Number of features.
    """

    def __init__(self, space: Box, features: int) -> None:
        super().__init__()
        self.unit = _Unit(space, None)
        sizes, pool = ((16, 5), (32, 3), (64, 3)), nn.AdaptiveAvgPool3d(_MAP_3D)
        self.net = nn.Sequential(*_convolutions(nn.Conv3d, self.unit.channels, sizes, pool, features))

    def forward(self, observation: Tensor) -> Tensor:
        """Features (rows, features) of voxels (rows, N, N, N)."""
        found: Tensor = self.net(self.unit(observation))
        return found


class VolumeNet(nn.Module):  # type: ignore[misc]
    """Features of voxels with channels (C, X, Y, Z) in a frame that is the same in every observation.

    Layers along x become channels of two strided convolutions over y and z, as in
    `graspbox.learn.models.scorer.network`.

    Parameters
    ----------
    space : Box
        Four axes, the first with the channels, and finite bounds.
    features : int
        Number of features.
    """

    low: Tensor
    span: Tensor

    def __init__(self, space: Box, features: int) -> None:
        super().__init__()
        low, high = float(space.low.min()), float(space.high.max())
        if not (np.isfinite([low, high]).all() and low < high):
            raise ConfigError(f"the bounds of {space} define the scaling; give finite ones, low below high")
        self.register_buffer("low", torch.tensor(low), persistent=False)
        self.register_buffer("span", torch.tensor(high - low), persistent=False)
        sizes, pool = ((32, 4), (48, 3), (64, 3)), nn.AdaptiveAvgPool2d(_MAP_3D)
        layers = _convolutions(nn.Conv2d, space.shape[0] * space.shape[1], sizes, pool, features)
        self.net = nn.Sequential(nn.Flatten(1, 2), *layers)

    def forward(self, observation: Tensor) -> Tensor:
        """Features (rows, features) of voxels (rows, C, X, Y, Z)."""
        found: Tensor = self.net((observation - self.low) / self.span)
        return found


class PointNet(nn.Module):  # type: ignore[misc]
    """Features of a point cloud, invariant to the order of its points; points at the origin are missing and left out.

    Parameters
    ----------
    space : Box
        (n, 3), or (H, W, 3) as an image of points.
    features : int
        Number of features.

    Notes
    -----
    The symmetric function of Qi, Su, Mo, Guibas, "PointNet: deep learning on point sets for 3D classification and
    segmentation", CVPR 2017, without its alignment networks.
    """

    middle: Tensor

    def __init__(self, space: Box, features: int) -> None:
        super().__init__()
        step = 1
        while np.prod([-(-side // step) for side in space.shape[:-1]]) > _MAX_POINTS:
            step += 1
        self._pick = (slice(None), *[slice(None, None, step)] * (len(space.shape) - 1))
        low, high = (bound.reshape(-1, 3) for bound in (space.low, space.high))
        if not np.isfinite([low, high]).all():
            raise ConfigError(f"the bounds of {space} define the scaling; give finite ones, low below high")
        middle, half = (low.min(0) + high.max(0)) / 2, (high.max(0) - low.min(0)).max() / 2
        self.register_buffer("middle", torch.as_tensor(middle, dtype=torch.float32), persistent=False)
        self._half = float(half)
        widths = (3, 32, 64, 128)
        layers = [(nn.Linear(a, b), nn.ReLU()) for a, b in pairwise(widths)]
        self.each = nn.Sequential(*[layer for pair in layers for layer in pair])
        self.all = nn.Sequential(nn.Linear(widths[-1], features), nn.ReLU())

    def forward(self, observation: Tensor) -> Tensor:
        """Features (rows, features) of points (rows, *shape)."""
        points = observation[self._pick].flatten(1, -2)
        missing = (points == 0).all(-1, keepdim=True)
        found = self.each((points - self.middle) / self._half)
        # A ReLU is not negative, so zero is the maximum over no points.
        pooled: Tensor = self.all(found.masked_fill(missing, 0.0).amax(1))
        return pooled


class _VectorInput(nn.Module):  # type: ignore[misc]
    def __init__(self, space: Box) -> None:
        super().__init__()
        self.size = space.shape[0]

    def forward(self, observation: Tensor) -> Tensor:
        return observation


def network(space: gymnasium.Space[Any], features: int) -> tuple[nn.Module, int]:
    """Choose the network of a space; returns it with the number of its features.

    Raises
    ------
    ConfigError
        For a space that is not in the table.
    """
    if isinstance(space, Box):
        if len(space.shape) == 1:
            return _VectorInput(space), space.shape[0]
        if _is_points(space):
            return PointNet(space, features), features
        if len(space.shape) == 3:
            if len(set(space.shape)) == 1:
                return VoxelNet(space, features), features
            if min(space.shape[0], space.shape[2]) <= _MAX_CHANNELS:
                return ImageNet(space, features), features
        if len(space.shape) == 4 and space.shape[0] <= _MAX_CHANNELS:
            return VolumeNet(space, features), features
    raise ConfigError(f"there is no network for {space}; give a vector, an image, points or voxels")


class Extractor(BaseFeaturesExtractor):  # type: ignore[misc]
    """Features of an observation; those of the entries of a ``Dict`` are concatenated.

    Parameters
    ----------
    observation_space : gymnasium.Space
        A ``Box``, or a ``Dict`` of them; see the module.
    features : int
        Number of features per image, point cloud or cube; vectors pass through.

    Raises
    ------
    ConfigError
        For a space that is not in the table of the module, or whose bounds are not finite.
    """

    def __init__(self, observation_space: gymnasium.Space[Any], features: int = 128) -> None:
        if features < 1:
            raise ConfigError(f"features is {features}; it must be at least 1")
        self._keys = tuple(observation_space) if isinstance(observation_space, gymnasium.spaces.Dict) else None
        spaces = observation_space.spaces if self._keys is not None else {"": observation_space}  # type: ignore[attr-defined]
        found = {name: network(space, features) for name, space in spaces.items()}
        super().__init__(observation_space, sum(size for _, size in found.values()))
        self.networks = nn.ModuleDict({f"of_{name}": net for name, (net, _) in found.items()})

    def forward(self, observations: Any) -> Tensor:
        """Features (rows, features_dim) of observations preprocessed by Stable-Baselines3."""
        if self._keys is None:
            found: Tensor = self.networks["of_"](observations)
            return found
        return torch.cat([self.networks[f"of_{name}"](observations[name]) for name in self._keys], dim=1)
