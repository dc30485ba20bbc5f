"""The three networks of the reference study.

In the notation C(filters, size, stride), P(pool), D(dropout), FC(units); convolutions have no padding, an activation
follows every C and every FC, and the last layer is linear with 7 outputs (position, quaternion) or 6 (position, Euler angles):

| network | layers |
|---|---|
| `Cnn2d` | C(32, 5, 1) C(32, 5, 1) C(32, 5, 1) P(2) C(32, 3, 1) P(2) C(32, 3, 1) P(2) C(32, 4, 1) P(2) FC(5500) FC(2500) FC(1500) |
| `Cnn2dDropout` | the same to the last P(2), then D(0.2) D(0.5) D(0.5) FC(1500) |
| `Cnn3d` | C(5, 3, 1) C(5, 3, 1) P(2) C(5, 3, 1) C(5, 3, 1) P(2) C(5, 2, 1) C(5, 2, 1) C(5, 2, 1) P(2) FC(550) FC(250) FC(150) |

The three dropouts of `Cnn2dDropout` are consecutive, as in the study: together they keep a fifth of the features.
"""  # noqa: E501 (a table)

from collections.abc import Callable, Sequence
from typing import ClassVar

import torch
from torch import Tensor, nn

from graspbox.errors import ConfigError
from graspbox.study.model_configs import Units

__all__ = ["NETWORKS", "Cnn2d", "Cnn2dDropout", "Cnn3d", "PoseNetwork", "Units"]


#: P(2): the maximum over disjoint blocks.
_POOL = 2


class PoseNetwork(nn.Module):  # type: ignore[misc]
    """A convolutional network from an image or a voxel grid to a pose, 7 or 6 outputs.

    Parameters
    ----------
    units : {"relu", "sigmoid"}
        Activation after each convolution and each fully connected layer but the last.
    zero_output : bool
        Initialize the last layer with zeros, as the study's program does; else with random weights like the others.
    size : int, optional
        Side of the input, pixels or voxels; by default the study's.
    fully_connected : sequence of int, optional
        Units of the fully connected layers before the last; by default the study's.
    generator : torch.Generator, optional
        Random number generator of the weights.
    """

    #: Axes of an input: 2 for images, 3 for voxels.
    axes: ClassVar[int]
    #: Side of an input in the study.
    size: ClassVar[int]
    #: C(filters, size, 1), and the sizes of pools.
    convolutions: ClassVar[tuple[tuple[int, int] | int, ...]]
    dropouts: ClassVar[tuple[float, ...]] = ()
    fully_connected: ClassVar[tuple[int, ...]]

    def __init__(
        self,
        outputs: int,
        *,
        units: Units = "relu",
        zero_output: bool = False,
        size: int | None = None,
        fully_connected: Sequence[int] | None = None,
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__()
        side = self.size if size is None else size
        self.input_shape = (1,) + (side,) * self.axes
        convolution, pool = (nn.Conv2d, nn.MaxPool2d) if self.axes == 2 else (nn.Conv3d, nn.MaxPool3d)
        unit: Callable[[], nn.Module] = nn.ReLU if units == "relu" else nn.Sigmoid
        layers: list[nn.Module] = []
        channels = 1
        for layer in self.convolutions:
            if isinstance(layer, int):
                layers.append(pool(layer))
                side //= layer
            else:
                layers += [convolution(channels, *layer), unit()]
                channels, side = layer[0], side - layer[1] + 1
        if side < 1:
            raise ConfigError(f"size is {size}; {type(self).__name__} needs a larger input")
        layers += [nn.Flatten(), *(nn.Dropout(share) for share in self.dropouts)]
        before = channels * side**self.axes
        for width in self.fully_connected if fully_connected is None else fully_connected:
            layers += [nn.Linear(before, width), unit()]
            before = width
        self.layers = nn.Sequential(*layers, nn.Linear(before, outputs))
        _initialize(self.layers, units, zero_output, generator)
        # In the channels-last format a training step of Cnn2d takes 1.8 s of CPU time instead of 2.8, one of Cnn3d 0.22
        # instead of 0.69 (batches of 10 and 6).
        self.to(memory_format=torch.channels_last if self.axes == 2 else torch.channels_last_3d)

    def forward(self, inputs: Tensor) -> Tensor:
        """Return outputs (n, 7 or 6) for inputs (n, 1, side, side) or (n, 1, side, side, side)."""
        outputs: Tensor = self.layers(inputs)
        return outputs


def _initialize(layers: nn.Sequential, units: Units, zero_output: bool, generator: torch.Generator | None) -> None:
    """Sample weights uniformly within +-sqrt(6 / (fan_in + fan_out)), 4 times that for sigmoid units; biases are 0.

    Source: X. Glorot, Y. Bengio, "Understanding the difficulty of training deep feedforward neural networks",
    AISTATS 2010. The last layer has no activation, so no factor.
    """
    with_weights = [layer for layer in layers if hasattr(layer, "weight")]
    for layer in with_weights:
        last = layer is with_weights[-1]
        nn.init.xavier_uniform_(layer.weight, 4.0 if units == "sigmoid" and not last else 1.0, generator)
        nn.init.zeros_(layer.bias)
    if zero_output:
        nn.init.zeros_(with_weights[-1].weight)


class Cnn2d(PoseNetwork):
    """The study's 2DCNN, for grey images of 256 x 256 pixels; 47.3 million weights."""

    axes = 2
    size = 256
    convolutions = ((32, 5), (32, 5), (32, 5), _POOL, (32, 3), _POOL, (32, 3), _POOL, (32, 4), _POOL)
    fully_connected: ClassVar[tuple[int, ...]] = (5500, 2500, 1500)


class Cnn2dDropout(Cnn2d):
    """The study's 2DCNN with dropout; 8.2 million weights."""

    dropouts = (0.2, 0.5, 0.5)
    fully_connected: ClassVar[tuple[int, ...]] = (1500,)


class Cnn3d(PoseNetwork):
    """The study's 3DCNN, for voxel grids of 64 x 64 x 64; 0.5 million weights."""

    axes = 3
    size = 64
    convolutions = ((5, 3), (5, 3), _POOL, (5, 3), (5, 3), _POOL, (5, 2), (5, 2), (5, 2), _POOL)
    fully_connected = (550, 250, 150)


#: Networks by name.
NETWORKS: dict[str, type[PoseNetwork]] = {"cnn2d": Cnn2d, "cnn2d_dropout": Cnn2dDropout, "cnn3d": Cnn3d}
